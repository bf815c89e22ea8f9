"""Deaths of processes: each told once, of those that are watched."""

import asyncio
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmware.master.deaths import ProcessWatcher


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


async def test_the_death_of_a_watched_process_is_told_once_and_of_another_not(
    children: list[subprocess.Popen[bytes]],
) -> None:
    told: asyncio.Queue[int] = asyncio.Queue()
    deaths = ProcessWatcher(told.put_nowait)
    kept, dropped = children
    deaths.watch({kept.pid, dropped.pid, os.getpid()})
    deaths.watch({kept.pid, os.getpid()})
    dropped.kill()
    dropped.wait()
    kept.kill()
    async with asyncio.timeout(5):
        assert await told.get() == kept.pid
    await asyncio.sleep(0)
    assert told.empty()
    deaths.close()


async def test_a_process_that_is_dead_already_is_told_at_once(
    children: list[subprocess.Popen[bytes]],
) -> None:
    told: asyncio.Queue[int] = asyncio.Queue()
    deaths = ProcessWatcher(told.put_nowait)
    children[0].kill()
    children[0].wait()
    deaths.watch({children[0].pid})
    async with asyncio.timeout(5):
        assert await told.get() == children[0].pid
    deaths.close()


async def test_nothing_is_told_after_the_end(children: list[subprocess.Popen[bytes]]) -> None:
    told: list[int] = []
    before = descriptors()
    deaths = ProcessWatcher(told.append)
    deaths.watch({child.pid for child in children})
    deaths.close()
    assert descriptors() == before
    children[0].kill()
    children[0].wait()
    await asyncio.sleep(0)
    assert told == []
