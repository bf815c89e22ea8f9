"""A node of one process per daemon, seen from inside and from the ground station, while each is killed."""

import asyncio
import os
import signal
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from tests.integration.swarm.starts import Starts
from tests.integration.swarm.swarm import Swarm, swarm, until, until_link, until_trees_agree, up
from tests.patience import PATIENCE_S

from swarmctl.session.labs import LabState
from swarmware.errors import SwarmError
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.types.health import WatchedService
from swarmware.types.net import Neighbours, Routes
from swarmware.types.system import AppStatus
from swarmware.types.tree import TreeGet, TreeValue
from swarmware.types.vehicle import Pose

SERVICES = (
    *("broker", "tree", "register", "timesync", "health", "mission", "logger"),
    *("hal", "sim", "control", "navigator"),
    "guard",  # the last: from another guard nobody learns how a process ended that it did not start
)
BOARDS = ("nav/pose", "sim/truth")
POSE = "/uav1/nav/pose"


class Joined:
    """Reports when an application has joined the node as another process."""

    def __init__(self, module: Module) -> None:
        self._node = module.node
        self._changed = asyncio.Event()

    def __enter__(self) -> "Joined":
        self._changes = self._node.applications.subscribe(lambda _: self._changed.set())
        return self

    def __exit__(self, *_: object) -> None:
        self._changes.close()

    def pid(self, name: str) -> int:
        """Process id of the application, or 0 if it does not run."""
        self._node.table.refresh(probe=True)
        entry = self._node.table.named(name)
        return 0 if entry is None else entry.pid

    def runs(self, name: str, dead_pid: int) -> Callable[[AppStatus], bool]:
        """Condition that a beat comes from the present process and not from the dead one.

        Two supervisors may start one each at the same instant; one of them ends again.
        """
        return lambda now: (
            now.state == "running" and now.pid not in {0, dead_pid} and now.pid == self.pid(name)
        )

    async def another(self, name: str, dead_pid: int) -> int:
        """The process that took its place."""
        async with asyncio.timeout(PATIENCE_S):
            while (pid := self.pid(name)) in {0, dead_pid}:
                self._changed.clear()
                await self._changed.wait()
        return pid


class Took(msgspec.Struct):
    """Seconds from the kill of a daemon."""

    joined_s: float = 0.0
    """Time until the application file names another process."""
    running_s: float = 0.0
    """Time until the first heartbeat of the new process."""
    swarm_s: float = 0.0
    """Time until the ground station has the link, fresh poses, and an answer of the node's tree."""
    silent_s: float = 0.0
    """Longest time without a new pose at the ground station."""

    def __str__(self) -> str:
        return " ".join(
            f"{name.removesuffix('_s')} {getattr(self, name):.2f}" for name in self.__struct_fields__
        )


class Silence:
    """Longest time between two values of a board."""

    def __init__(self, board: BoardReader[Pose]) -> None:
        self._board = board
        self._loop = asyncio.get_running_loop()
        self._last_s = self._loop.time()
        self.worst_s = 0.0

    def begin(self) -> None:
        """Another measurement."""
        self.worst_s = 0.0

    async def listen(self) -> None:
        """Until cancelled."""
        while True:
            await self._board.changed()
            now_s = self._loop.time()
            self.worst_s = max(self.worst_s, now_s - self._last_s)
            self._last_s = now_s


async def answer(module: Module) -> TreeValue:
    """The pose, asked of the platform itself; as soon as it answers."""
    routes = module.reader("net/routes", Routes)
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                return await module.request("/uav1/sys/tree/get", TreeGet(POSE), TreeValue, timeout_s=1)
            except SwarmError:
                await routes.changed()  # written once a second, and when the way there changes


def readable(module: Module, dead: str) -> None:
    """Asserts that a late reader can read the boards that a dead service and others left."""
    late: list[BoardReader[AppStatus] | BoardReader[Pose]] = [module.reader(f"app/{dead}/status", AppStatus)]
    late += [module.reader(path, Pose) for path in BOARDS]
    for board in late:
        assert board.value is not None, f"{board.path} cannot be read without {dead}"
        board.close()


async def kill_in_turn(made: Swarm, starts: Starts, after_each: Callable[[str], object]) -> dict[str, Took]:
    found: dict[str, Took] = {}
    loop = asyncio.get_running_loop()
    async with made.at("uav1") as inside, made.at("gcs") as outside:
        own = {path: inside.reader(path, Pose) for path in BOARDS}
        beats = {name: inside.reader(f"app/{name}/status", AppStatus) for name in SERVICES}
        neighbours = outside.reader("net/neighbours", Neighbours)
        mirror = outside.reader(POSE, Pose)
        silence = Silence(outside.reader(POSE, Pose))
        outside.start(silence.listen(), "silence")
        restarts = inside.stream_reader("guard/restarts", WatchedService)
        with Joined(inside) as joined:
            for name in SERVICES:
                await starts.measure()
                for board in own.values():
                    await board.changed(PATIENCE_S)
                dead_pid, took = joined.pid(name), Took()
                silence.begin()
                began_s = loop.time()
                os.kill(dead_pid, signal.SIGKILL)
                another = asyncio.create_task(joined.another(name, dead_pid))
                while not another.done():
                    readable(inside, name)
                    await asyncio.sleep(0.005)
                another.result()
                took.joined_s = loop.time() - began_s
                await until(beats[name], joined.runs(name, dead_pid), f"{name} again")
                took.running_s = loop.time() - began_s
                if name != "guard":
                    told = await restarts.next(PATIENCE_S)
                    assert (told.name, told.reason) == (name, "died: signal 9")
                assert all(board.value is not None for board in own.values()), f"boards gone without {name}"
                await until(neighbours, lambda now: "uav1" in up(now), f"with uav1 after {name}")
                for _ in range(2):  # the first may have been on its way
                    await mirror.changed(PATIENCE_S)
                assert (await answer(outside)).quality == "live"
                took.swarm_s = loop.time() - began_s
                await asyncio.to_thread(after_each, name)
                took.silent_s = silence.worst_s
                found[name] = took
    return found


async def kill_all_but_the_monitor(made: Swarm) -> None:
    async with made.at("uav1") as inside, made.at("gcs") as outside:
        beats = {name: inside.reader(f"app/{name}/status", AppStatus) for name in SERVICES}
        for name, board in beats.items():
            await until(board, lambda now: now.state == "running", f"{name} running")
        await until_link(outside, "uav1", is_up=True)
        loop = asyncio.get_running_loop()
        with Joined(inside) as joined:
            dead = {name: joined.pid(name) for name in SERVICES if name != "health"}
            began_s = loop.time()
            for pid in dead.values():
                os.kill(pid, signal.SIGKILL)
            for name, pid in dead.items():
                await until(beats[name], joined.runs(name, pid), f"{name} again")
        whole_s = loop.time() - began_s
        mirror = outside.reader(POSE, Pose)
        for _ in range(2):
            await mirror.changed(PATIENCE_S)
        await until_trees_agree(inside, outside)
        print(f"ten daemons at once: whole {whole_s:.2f} s, swarm {loop.time() - began_s:.2f} s")


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_killed_daemons_return_in_time_and_swarm_recovers(
    labs_folder: Path, tmp_path: Path, ctl: Callable[..., object], nothing_remains: Callable[[LabState], None]
) -> None:
    starts = Starts(tmp_path)

    async def run() -> tuple[LabState, dict[str, Took]]:
        async with swarm("k2daemons", per_daemon="uav1") as made:
            await made.start("uav1", "gcs", "ugv1")
            found = await kill_in_turn(made, starts, lambda _: ctl("tree", "get", POSE, "--lab", "k2daemons"))
            await kill_all_but_the_monitor(made)
            return made.record, found

    lab, found = asyncio.run(run())
    for name, took in found.items():
        print(f"{name:<10} {took}")
    running_s = {name: took.running_s for name, took in found.items()}
    print(starts.report(running_s))
    nothing_remains(lab)
    assert running_s.keys() == set(SERVICES)
    assert starts.late(running_s) == [], starts.report(running_s)
