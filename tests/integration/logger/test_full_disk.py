"""A really full file system: it is shown, nothing is half-changed, and later the record has no hole."""

import asyncio
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from tests.integration.logger.events import counted, events, flushed
from tests.patience import PATIENCE_S

from swarmctl.commands.doctor.checks import examine
from swarmware.errors import SwarmError
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.recorder.query import FolderSource, Query
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.health import HealthState
from swarmware.types.scalar import Int
from swarmware.types.tree import TreeGet, TreeSet, TreeSetDone, TreeValue

GAIN = "config/navigator/altitude_kp"
FULL = "logger/disk=full"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """The data folder of the node: a file system of 1 MiB."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("needs root and mount, for a small file system of its own")
    folder = tmp_path / "uav1" / "data"
    folder.mkdir(parents=True)
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "swarm-test", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip(f"a tmpfs cannot be mounted here: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def fill(folder: Path) -> Path:
    """Takes all the room that is left."""
    file = folder / "filler"
    with file.open("wb", buffering=0) as out, pytest.raises(OSError, match="No space"):
        while True:
            out.write(bytes(4096))
    return file


async def until_shown(health: BoardReader[HealthState], *, full: bool) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while (health.value is not None and FULL in health.value.faults) != full:
            await health.changed()


async def set_gain(module: Module, value: float) -> TreeSetDone:
    return await module.request(
        "sys/tree/set",
        TreeSet(f"/uav1/{GAIN}", msgspec.msgpack.encode(value)),
        TreeSetDone,
        timeout_s=PATIENCE_S,
    )


async def test_full_disk_is_shown_and_later_costs_nothing(tmp_path: Path, small_disk: Path) -> None:
    settings = {"flush_s": 0.1, "min_free_bytes": 0}
    config = make_node(tmp_path, kind="uav", services={"logger": settings, "health": {}, "tree": {}})
    log = small_disk / "log"
    async with Module("source", config_dir=config) as module:
        health = module.reader("health/state", HealthState)
        writer = events(module, slots=1024)
        async with spawn(config, "logger", "health", "tree"):
            writer.write(Int(0))
            assert (await set_gain(module, 1.5)).version == 1
            await flushed(module)
            filler = fill(small_disk)
            for number in range(1, 400):
                writer.write(Int(number))
            await until_shown(health, full=True)
            results = await asyncio.to_thread(examine, {"uav1": config}, fix=False)
            found = {result.text for result in results if result.check == "fault"}
            assert any(
                text.startswith("logger/disk: full: ") and f"{log}: No space left" in text for text in found
            ), found

            with pytest.raises(SwarmError, match="cannot be stored"):
                await set_gain(module, 2.0)
            kept = await module.request(
                "sys/tree/get", TreeGet(f"/uav1/{GAIN}"), TreeValue, timeout_s=PATIENCE_S
            )
            assert (msgspec.msgpack.decode(kept.data), kept.version) == ([1.5], 1)

            filler.unlink()
            await until_shown(health, full=False)
            assert (await set_gain(module, 2.0)).version == 2
            stats = await flushed(module)
            assert (counted(log), stats.gaps) == (list(range(400)), 0)

        filler = fill(small_disk)
        for number in range(400, 500):
            writer.write(Int(number))
        async with spawn(config, "logger", "health"):
            await until_shown(health, full=True)
            filler.unlink()
            await until_shown(health, full=False)
            stats = await flushed(module)
            assert (counted(log), stats.gaps) == (list(range(500)), 0)
    assert FolderSource([log]).losses() == []
    assert [entry.path for entry in FolderSource([log]).entries(Query(pattern="/uav1/log/gaps"))] == []
