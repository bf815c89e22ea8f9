"""A node of one process per daemon: each is killed in turn, and comes back while the others go on."""

import asyncio
import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmctl.lab import record
from swarmctl.lab.record import LabRecord, NodeRecord
from swarmware.appfile import AppEntry
from swarmware.errors import NoAnswer
from swarmware.module import Module
from swarmware.types.system import AppStatus
from swarmware.types.vehicle import Pose

Done = subprocess.CompletedProcess[str]

SERVICES = (
    *("broker", "tree", "register", "timesync", "health", "guard", "mission", "logger"),
    *("hal", "sim", "navigator"),
)
BACK_S = 10.0
"""A loaded machine is slow; how fast it is on a quiet one is printed, and measured by the bench."""
BOARDS = ("nav/pose", "sim/truth")


def application(module: Module, name: str) -> AppEntry | None:
    module.node.table.refresh(probe=True)
    return next((entry for entry in module.node.table if entry.name == name), None)


async def back(module: Module, name: str, dead_pid: int) -> float:
    """Seconds until the service reports as another process that it runs."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    status = await module.reader(f"app/{name}/status", AppStatus)
    while True:
        value = status.value
        if value is not None and value.pid != dead_pid and value.state == "running":
            return loop.time() - began_s
        if loop.time() - began_s > BACK_S:
            raise NoAnswer(f"{name}: not back within {BACK_S} s")
        try:
            await status.changed(0.5)
        except NoAnswer:
            continue


async def kill_all_in_turn(node: NodeRecord) -> dict[str, float]:
    found = {}
    async with Module("killer", config_dir=node.config_dir) as module:
        boards = [await module.reader(path, Pose) for path in BOARDS]
        for name in SERVICES:
            for board in boards:
                await board.changed(BACK_S)
            entry = application(module, name)
            assert entry is not None, f"{name} does not run"
            os.kill(entry.pid, signal.SIGKILL)
            waiting = asyncio.create_task(back(module, name, entry.pid), name=name)
            while not waiting.done():
                assert all(board.value is not None for board in boards), f"boards gone without {name}"
                await asyncio.wait([waiting], timeout=0.02)
            found[name] = await waiting
            if name == "guard":
                # its successor takes over those that run; it must know them before another is killed
                await (await module.reader("app/guard/status", AppStatus)).changed(BACK_S)
    return found


@pytest.mark.slow
def test_every_daemon_of_a_node_comes_back_when_it_is_killed(
    ctl: Callable[..., Done], labs: Path, nothing_remains: Callable[[LabRecord], None]
) -> None:
    ctl("lab", "up", "formation", "--nodes", "3", "--per-daemon", "uav1", "--detach")
    lab = record.find()
    times = asyncio.run(kill_all_in_turn(lab.node("uav1")))
    print({name: round(seconds, 2) for name, seconds in times.items()})
    ctl("lab", "down")
    nothing_remains(lab)
