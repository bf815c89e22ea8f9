"""Watched processes: the end of each is reported once; signals reach the very process."""

import asyncio
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.runtime.processes import ProcessWatcher, WatchedProcess, process_end


def descriptors() -> int:
    """How many this process has open."""
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.fixture
def children() -> Iterator[list[subprocess.Popen[bytes]]]:
    """Processes that wait to be killed."""
    made = [subprocess.Popen(["sleep", "60"]) for _ in range(2)]
    yield made
    for child in made:
        child.kill()
        child.wait()


async def test_end_of_watched_process_is_reported_once(
    children: list[subprocess.Popen[bytes]],
) -> None:
    ended: asyncio.Queue[int] = asyncio.Queue()
    watcher = ProcessWatcher(ended.put_nowait)
    kept, dropped = children
    watcher.watch({kept.pid, dropped.pid, os.getpid()})
    watcher.watch({kept.pid, os.getpid()})
    dropped.kill()
    dropped.wait()
    kept.kill()
    async with asyncio.timeout(PATIENCE_S):
        assert await ended.get() == kept.pid
    await asyncio.sleep(0)
    assert ended.empty()
    watcher.close()


async def test_already_ended_process_is_reported_at_once(
    children: list[subprocess.Popen[bytes]],
) -> None:
    ended: asyncio.Queue[int] = asyncio.Queue()
    watcher = ProcessWatcher(ended.put_nowait)
    children[0].kill()
    children[0].wait()
    watcher.watch({children[0].pid})
    async with asyncio.timeout(PATIENCE_S):
        assert await ended.get() == children[0].pid
    watcher.close()


async def test_end_is_reported_once_despite_repeated_watch(
    children: list[subprocess.Popen[bytes]],
) -> None:
    ended: list[int] = []
    wanted = {child.pid for child in children}
    for child in children:
        child.kill()
    children[0].wait()  # the other one stays a zombie, which can still be watched

    def on_end(pid: int) -> None:
        ended.append(pid)
        watcher.watch(wanted)

    watcher = ProcessWatcher(on_end)
    watcher.watch(wanted)
    async with asyncio.timeout(PATIENCE_S):
        while len(ended) < len(wanted):  # noqa: ASYNC110 - what is counted is the calls themselves
            await asyncio.sleep(0)
    for _ in range(10):
        watcher.watch(wanted)
        await asyncio.sleep(0)
    assert sorted(ended) == sorted(wanted)
    watcher.close()


async def test_ended_process_is_not_reported_after_closing(
    children: list[subprocess.Popen[bytes]],
) -> None:
    ended: list[int] = []
    watcher = ProcessWatcher(ended.append)
    children[0].kill()
    children[0].wait()
    watcher.watch({children[0].pid})
    watcher.close()
    await asyncio.sleep(0)
    assert ended == []


async def test_nothing_is_reported_after_closing(children: list[subprocess.Popen[bytes]]) -> None:
    ended: list[int] = []
    before = descriptors()
    watcher = ProcessWatcher(ended.append)
    watcher.watch({child.pid for child in children})
    watcher.close()
    assert descriptors() == before
    children[0].kill()
    children[0].wait()
    await asyncio.sleep(0)
    assert ended == []


async def test_signal_and_end_precede_close_of_watch(
    children: list[subprocess.Popen[bytes]],
) -> None:
    ended = asyncio.Event()
    before = descriptors()
    process = WatchedProcess(children[0].pid, ended.set)
    process.signal(signal.SIGTERM)
    async with asyncio.timeout(PATIENCE_S):
        await ended.wait()
    assert children[0].wait() == -signal.SIGTERM
    process.signal(signal.SIGKILL)  # nothing: the number may have another owner by now
    process.close()
    assert descriptors() == before


async def test_waiter_for_process_returns_or_is_refused(
    children: list[subprocess.Popen[bytes]],
) -> None:
    before = descriptors()
    waiting = asyncio.create_task(process_end(children[0].pid))
    await asyncio.sleep(0)
    children[0].kill()
    async with asyncio.timeout(PATIENCE_S):
        await waiting
    children[0].wait()
    with pytest.raises(ProcessLookupError):
        await process_end(children[0].pid)
    assert descriptors() == before
