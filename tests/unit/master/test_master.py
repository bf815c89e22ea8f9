"""The master's duty: who is here is published, and the dead are tidied up after."""

import asyncio
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from tests.patience import PATIENCE_S, until

from swarmware.module.module import Module
from swarmware.node.master import master
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.appfile.entry import encode
from swarmware.types.register import ApplicationTable
from swarmware.types.scalar import Int

HOLDER = """
import fcntl, os, sys
fd = os.open(sys.argv[1], os.O_RDWR)
fcntl.flock(fd, fcntl.LOCK_EX)
print(flush=True)
sys.stdin.read()
"""
"""A process with an application file: alive as long as it holds the lock."""


@pytest.fixture(autouse=True)
def no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each change of the register is a table of its own at once."""
    monkeypatch.setattr(master, "PAUSE_S", 0.0)


async def table_where(module: Module, wanted: Callable[[set[str]], bool]) -> ApplicationTable:
    """The first published table with applications of which `wanted` is true."""
    board = module.reader("register/apps", ApplicationTable)
    async with asyncio.timeout(PATIENCE_S):
        while (table := board.value) is None or not wanted({app.name for app in table.applications}):
            await board.changed()
    return table


async def test_arrivals_and_departures_make_later_table(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        alone = await table_where(m, lambda names: names == {"planner"})
        async with Module("pilot", node=node) as pilot:
            pilot.inbox("cmd/step", Int)
            both = await table_where(m, lambda names: names == {"planner", "pilot"})
        again = await table_where(m, lambda names: names == {"planner"})
        assert alone.version < both.version < again.version
        assert {table.epoch for table in (alone, both, again)} == {node.master.holder.epoch}
        assert (alone.platform, alone.boot_id, alone.omitted) == ("uav1", node.clock.boot_id, 0)
        assert not any(app.endpoint or app.serves for app in both.applications), "as it is published"
        (full,) = node.master.table(full=True).applications
        assert full.endpoint == node.messaging.address


async def test_table_that_says_same_is_not_published_again(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        alone = await table_where(m, lambda names: names == {"planner"})
        for path in ("sensor/a", "sensor/b", "sensor/c"):
            m.reader(path, Int)  # in the application file, not in the table
        async with Module("pilot", node=node):
            both = await table_where(m, lambda names: names == {"planner", "pilot"})
        assert both.version == alone.version + 1


async def test_holder_becoming_preferred_continues_table_numbers(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        board = m.reader("register/apps", ApplicationTable)
        first = await table_where(m, lambda names: names == {"planner"})
        node.master.volunteer("register#1")
        async with asyncio.timeout(PATIENCE_S):
            while (table := board.value) is None or table.master != "register#1":
                await board.changed()
        assert table.epoch == first.epoch, "it had the role already"
        assert table.version > first.version


async def test_remains_of_dead_process_are_removed(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        apps = node.run_dir / "apps"
        file = apps / "pilot#1.toml"
        made = tmp_path / "pilot"
        child = await asyncio.to_thread(started, made)
        made.write_bytes(encode(msgspec.structs.replace(m.entry, name="pilot", pid=child.pid)))
        made.rename(file)
        left = [node.run_dir / "p" / f"{child.pid}-1.sock", node.run_dir / "bells" / f"{child.pid}-1"]
        others = [node.run_dir / "p" / "1-1.sock"]
        for path in (*left, *others):
            path.touch()
        node.announce_apps()
        before = await table_where(m, lambda names: names == {"planner", "pilot"})
        assert {app.name: app.pid for app in before.applications}["pilot"] == child.pid
        child.kill()
        await asyncio.to_thread(child.communicate)
        await table_where(m, lambda names: names == {"planner"})
        assert not file.exists()
        assert (apps / "pilot#1.dead").exists(), "the name is free, the trace stays"
        assert [path.exists() for path in (*left, *others)] == [False, False, True]


async def test_more_applications_than_a_table_holds_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(master, "APPLICATIONS_LIMIT", 1)
    async with (
        tmp_node(tmp_path) as node,
        Module("planner", node=node),
        Module("pilot", node=node),
    ):
        table = node.master.table(full=False)
        assert (len(table.applications), table.omitted) == (1, 1)


def started(file: Path) -> "subprocess.Popen[bytes]":
    """The process, once it holds its lock."""
    file.touch()
    child = subprocess.Popen(
        [sys.executable, "-S", "-E", "-c", HOLDER, str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert child.stdout is not None
    child.stdout.readline()
    return child


async def test_foreign_file_is_named_once_and_removed(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmware.node.node.TEND_NS", 10_000_000)
    monkeypatch.setattr("swarmware.node.node.TEND_PHASE_NS", 0)
    reported: list[tuple[str, ...]] = []
    async with tmp_node(tmp_path) as node, Module("planner", node=node):
        node.master.on_rejections = reported.append
        strange = node.run_dir / "apps/x#1.toml"
        for number in (1, 2):
            os.mkfifo(strange)
            await until(lambda: not strange.exists() and len(reported) >= 2 * number)  # noqa: B023
            assert reported[-2:] == [(f"{strange}: a FIFO; expected a regular file",), ()]
    assert caplog.text.count("a FIFO") == 1
