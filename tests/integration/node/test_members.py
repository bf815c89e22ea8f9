"""Members of a node's group with the least rights: they neither answer nor swallow the orders of others."""

import asyncio
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.integration.node import member
from tests.integration.node.commands import VEHICLE, swarmctl
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmware.errors import NotFound
from swarmware.module.module import Module
from swarmware.testing.process import run_python, spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.health import FaultList, FaultQuery

MEMBER, GROUP = 60_102, 60_100
PROGRAM = str(Path(member.__file__))

pytestmark = [
    pytest.mark.root,
    pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to become another user"),
]


@pytest.fixture
def root() -> Iterator[Path]:
    """A short folder that all users may enter."""
    folder = Path(tempfile.mkdtemp(prefix="sw", dir="/tmp"))
    folder.chmod(0o755)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def node_with_group(root: Path, processes: str) -> Path:
    """Configuration of a vehicle whose run directory a group may read."""
    services: dict[str, dict[str, Any]] = {name: {} for name in VEHICLE}
    services["broker"] = {"bind_address": "127.0.0.1", "multicast_group": "", "udp_port": free_port()}
    config = make_node(root, services=services, processes=processes)
    run_dir = root / "uav1/run"
    run_dir.mkdir(mode=0o750)
    os.chown(run_dir, 0, GROUP)
    return config


@pytest.mark.parametrize("processes", ["one", "per-daemon"])
def test_orders_reach_daemons_although_member_claims_their_addresses(root: Path, processes: str) -> None:
    async def attack() -> None:
        config = node_with_group(root, processes)
        async with (
            spawn(config),
            run_python(PROGRAM, str(config), str(MEMBER), str(GROUP)) as attacker,
            Module("probe", config_dir=config) as m,
        ):
            assert int(await attacker.line()) > 40
            await swarmctl(config, "takeoff", "uav1", "--altitude", "5", "--timeout", str(PATIENCE_S))
            output = [
                await swarmctl(config, "config", "set", "navigator/altitude_kp", "0.777"),
                await swarmctl(config, "config", "get", "navigator/altitude_kp"),
                await swarmctl(
                    config, "mission", "abort", "--then", "hold", "--yes", code=NotFound.exit_code
                ),
                await swarmctl(config, "hold", "uav1"),
                await swarmctl(config, "land", "uav1", "--timeout", str(PATIENCE_S)),
                await swarmctl(config, "kill", "uav1", "--confirm", "uav1"),
            ]
            assert "0.777" in output[1]
            assert "no mission was started" in output[2]
            assert member.TAKEN not in "".join(output)
            faults = await m.request("sys/health/faults", FaultQuery(), FaultList, timeout_s=PATIENCE_S)
            details = [fault.freeze for fault in faults.faults if fault.check == "register/applications"]
            assert details, faults
            assert details[0].startswith("zzz#1 of user 60102 claims sys/")
            assert attacker.returncode is None

    asyncio.run(attack())
