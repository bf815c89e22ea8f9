"""Any process of the node restarts a guard that died, but not a guard that left the node."""

import asyncio
import fcntl
import logging
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from swarmware.node.node import Node
from swarmware.service import guard_watchdog
from swarmware.service.fork_client import StartedProcess
from swarmware.service.guard_watchdog import GuardWatchdog
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.appfile.trace import MOMENT_S

GUARD = """
import asyncio, sys
import msgspec
from swarmware.module.module import Module

class Settings(msgspec.Struct):
    supervisor: str

async def main():
    async with Module("guard", config_dir=sys.argv[1], config=Settings(sys.argv[2])):
        print("runs", flush=True)
        await asyncio.Event().wait()

asyncio.run(main())
"""


class Starts:
    """Starts that the watchdog requested, in place of a real guard."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.error: OSError | None = None
        self.pids: list[int] = []
        self._event = asyncio.Event()

    def __call__(self, name: str, config_dir: Path, run_dir: Path) -> StartedProcess | None:
        if self.pids and _runs(self.pids[-1]):
            return None  # it is being started
        self.names.append(name)
        self._event.set()
        if self.error is not None:
            error, self.error = self.error, None
            raise error
        self.pids.append(
            os.posix_spawn(sys.executable, [sys.executable, "-c", "import time; time.sleep(60)"], os.environ)
        )
        return StartedProcess(self.pids[-1])

    async def wait(self, count: int) -> None:
        async with asyncio.timeout(20.0):
            while len(self.names) < count:
                self._event.clear()
                await self._event.wait()

    def end(self) -> None:
        for pid in self.pids:
            if _runs(pid):
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)


def _runs(pid: int) -> bool:
    try:
        return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None
    except ChildProcessError:
        return False


@asynccontextmanager
async def guard(node: Node, supervisor: str = "self") -> AsyncIterator[asyncio.subprocess.Process]:
    """A process that is the guard of this node."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", GUARD, str(node.config_dir), supervisor, stdout=asyncio.subprocess.PIPE
    )
    try:
        assert process.stdout is not None
        assert await asyncio.wait_for(process.stdout.readline(), 30.0) == b"runs\n"
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


@asynccontextmanager
async def watching(node: Node, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Starts]:
    monkeypatch.setattr(guard_watchdog, "LOOK_S", 0.02)
    starts = Starts()
    monkeypatch.setattr(guard_watchdog, "spawn_missing", starts)
    task = asyncio.create_task(GuardWatchdog(node).run())
    await asyncio.sleep(0)
    try:
        yield starts
    finally:
        task.cancel()
        await asyncio.wait([task])
        starts.end()


async def test_a_guard_that_was_killed_is_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path) as node, guard(node) as process, watching(node, monkeypatch) as starts:
        assert starts.names == [], "it runs"
        process.kill()
        await starts.wait(1)
        assert starts.names == ["guard"]
        assert f"guard: died; started again, pid {starts.pids[0]}" in caplog.text


async def test_guard_with_briefly_locked_file_is_restarted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with tmp_node(tmp_path) as node, guard(node) as process, watching(node, monkeypatch) as starts:
        with (node.run_dir / "apps/guard#1.toml").open("rb") as file:
            process.kill()
            fcntl.flock(file, fcntl.LOCK_EX)  # as the master does, which moves the file aside
            for _ in range(5):
                await asyncio.sleep(MOMENT_S)
            assert starts.names == [], "what its end was cannot be seen yet"
        await starts.wait(1)
        assert starts.names == ["guard"]


async def test_process_ended_before_joining_is_restarted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path) as node:
        async with guard(node) as process:
            process.kill()
            await process.wait()
        async with watching(node, monkeypatch) as starts:  # it died before this process came
            await starts.wait(1)
            os.kill(starts.pids[0], signal.SIGKILL)
            await starts.wait(2)
            assert "guard: ended: signal 9" in caplog.text


async def test_start_that_fails_is_logged_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path) as node, guard(node) as process, watching(node, monkeypatch) as starts:
        starts.error = OSError(11, "no more processes")
        process.kill()
        await starts.wait(2)
        (record,) = [one for one in caplog.records if one.levelno == logging.ERROR]
        assert record.getMessage() == "guard: cannot be started: [Errno 11] no more processes"


@pytest.mark.parametrize(
    ("supervisor", "number"),
    [("self", signal.SIGTERM), ("systemd", signal.SIGKILL), ("systemd", signal.SIGTERM)],
)
async def test_departed_or_systemd_restarted_guard_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, supervisor: str, number: signal.Signals
) -> None:
    async with (
        tmp_node(tmp_path) as node,
        guard(node, supervisor) as process,
        watching(node, monkeypatch) as starts,
    ):
        process.send_signal(number)
        await process.wait()
        async with guard(node) as second:  # found by the watchdog as the running guard
            assert starts.names == []
            second.kill()
            await starts.wait(1)
