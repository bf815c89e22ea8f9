"""The master role between real processes: killed, taken over and returned, without effects on other
processes."""

import asyncio
import contextlib
import os
import signal
import time
from pathlib import Path

from tests.patience import PATIENCE_S, until

from swarmware.errors import SwarmError
from swarmware.module.module import Module
from swarmware.node.master.role import LeaderCandidate
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.register import ApplicationTable, Register
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo
from swarmware.types.time import TimeFunctions

SOON_S = 0.3
"""Time within which the end of a master is noticed: by an event, not by a look once a second."""


async def table_where(module: Module, wanted: object) -> ApplicationTable:
    """The first published table of which `wanted` is true."""
    board = module.reader("register/apps", ApplicationTable)
    assert callable(wanted)
    async with asyncio.timeout(PATIENCE_S):
        while (table := board.value) is None or not wanted(table):
            with contextlib.suppress(SwarmError):
                await board.changed(timeout_s=0.5)
    return table


async def another_epoch(module: Module, epoch: int) -> None:
    """Returns within a millisecond of the take-over: the lock file itself is looked at."""
    await until(lambda: module.node.master.holder.epoch != epoch)


def is_master(module: Module) -> bool:
    return module.node.master.holder.pid == os.getpid()


def names(table: ApplicationTable) -> set[str]:
    return {app.name for app in table.applications}


async def test_killed_master_is_replaced_and_regains_role(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"register": {}, "timesync": {}})
    with no_leaks(tmp_path / "uav1/run"):
        async with Module("probe", config_dir=config) as module, spawn(config, "timesync"):
            took_s: list[float] = []
            answered: asyncio.Queue[SwarmError | None] = asyncio.Queue()

            async def keep_asking() -> None:
                while True:
                    try:
                        await module.request(
                            "sys/time/functions", Empty(), TimeFunctions, timeout_s=PATIENCE_S
                        )
                        answered.put_nowait(None)
                    except SwarmError as error:
                        answered.put_nowait(error)
                    await asyncio.sleep(0.005)

            asking = asyncio.create_task(keep_asking())
            try:
                # at least three; more where a busy computer was late in all of them
                while len(took_s) < 3 or (min(took_s) >= SOON_S and len(took_s) < 9):
                    async with spawn(config, "register") as register:
                        before = await table_where(module, lambda table: table.master == "register#1")
                        assert names(before) >= {"probe", "timesync", "register"}
                        killed_s = time.monotonic()
                        register.signal(signal.SIGKILL)
                        await another_epoch(module, before.epoch)
                        took_s.append(time.monotonic() - killed_s)
                        epoch = before.epoch
                        after = await table_where(module, lambda table, old=epoch: table.epoch > old)
                        assert "register" not in names(after)
                    async with asyncio.timeout(PATIENCE_S):  # of those before, meanwhile and afterwards
                        for _ in range(answered.qsize() + 10):
                            assert await answered.get() is None
            finally:
                asking.cancel()
                await asyncio.wait([asking])
            assert min(took_s) < SOON_S, took_s


async def test_files_of_dead_are_set_aside_by_master(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"timesync": {}})
    async with Module("probe", config_dir=config) as module:
        assert module.node.master.holder.pid == os.getpid()
        async with spawn(config, "timesync") as process:
            await table_where(module, lambda table: names(table) == {"probe", "timesync"})
            process.signal(signal.SIGKILL)
            await table_where(module, lambda table: names(table) == {"probe"})
            files = {path.name for path in (tmp_path / "uav1/run/apps").iterdir()}
            assert files == {"probe#1.toml", "timesync#1.dead"}, "the name is free, the trace stays"
            left = [*(tmp_path / "uav1/run/p").iterdir(), *(tmp_path / "uav1/run/bells").iterdir()]
            assert not [path for path in left if str(process.pid) in path.name]


async def test_register_answers_process_places_and_node_identity(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"register": {}})
    async with spawn(config, "register"), Module("probe", config_dir=config) as module:
        register = await module.request("sys/register/apps", Empty(), Register, timeout_s=PATIENCE_S)
        (unit,) = register.units
        assert (unit.table.platform, unit.hops) == ("uav1", 0)
        assert unit.table.master == "register#1"
        me = next(app for app in unit.table.applications if app.name == "probe")
        assert (me.pid, me.endpoint) == (os.getpid(), module.node.messaging.address)
        info = await module.request("sys/node/info", Empty(), NodeInfo, timeout_s=PATIENCE_S)
        assert (info.platform, info.kind, info.boot_id) == ("uav1", "uav", module.clock.boot_id)
        assert set(info.services) == {"register", "probe"}
        assert 0 <= info.uptime_s < 3600


class Candidate:
    """A role of its own, in the process of the test: rings all others."""

    def __init__(self, run_dir: Path, label: str, others: "list[Candidate]") -> None:
        self.epochs: list[int] = []
        self.lost = 0
        self._others = others
        self.role = LeaderCandidate(
            run_dir, label, ring=self._ring, on_gained=self.epochs.append, on_lost=self._lose
        )
        others.append(self)
        self.role.start()

    def _ring(self) -> None:
        loop = asyncio.get_running_loop()
        for other in self._others:
            if other is not self:
                loop.call_soon(other.role.poll)

    def _lose(self) -> None:
        self.lost += 1


async def holder(candidates: list[Candidate]) -> Candidate:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            await asyncio.sleep(0)
            holding = [one for one in candidates if one.role.holding]
            assert len(holding) <= 1
            if holding:
                return holding[0]


async def test_one_master_at_time_has_growing_fencing_number(tmp_path: Path) -> None:
    everybody: list[Candidate] = []
    for number in range(5):
        Candidate(tmp_path, f"candidate {number}", everybody)
    last = 0
    while everybody:
        master = await holder(everybody)
        assert master.epochs == [last + 1]
        last += 1
        assert all(one.role.holder.epoch == last for one in everybody)
        everybody.remove(master)
        master.role.close()
        assert master.lost == 1


async def test_preferred_process_keeps_its_role(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"register": {}, "timesync": {}})
    async with Module("probe", config_dir=config) as module:
        assert is_master(module)
        async with spawn(config, "register"):
            await table_where(module, lambda table: table.master == "register#1")
            assert not is_master(module)
            epoch = module.node.master.holder.epoch
            async with spawn(config, "timesync"):
                await table_where(module, lambda table: "timesync" in names(table))
                assert module.node.master.holder.epoch == epoch
        await table_where(module, lambda table: table.epoch > epoch)


async def test_fencing_number_continues_after_all_left(tmp_path: Path) -> None:
    everybody: list[Candidate] = []
    Candidate(tmp_path, "first", everybody).role.close()
    everybody.clear()
    again = Candidate(tmp_path, "second", everybody)
    assert again.epochs == [2]
    again.role.close()
