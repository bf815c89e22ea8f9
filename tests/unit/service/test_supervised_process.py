"""A supervised process: its end is reported once, with the status that its parent collected."""

import asyncio
import os
import signal
import socket
import sys

import pytest

from swarmware.errors import NotFound
from swarmware.service import supervised_process
from swarmware.service.exit_status import ExitStatus
from swarmware.service.fork_client import StartedProcess
from swarmware.service.supervised_process import SupervisedProcess


def child(code: str = "import time; time.sleep(60)") -> int:
    return os.posix_spawn(sys.executable, [sys.executable, "-c", code], os.environ)


def reap(pid: int) -> None:
    os.waitpid(pid, 0)


class Ends:
    """Reported ends of one process."""

    def __init__(self) -> None:
        self.reported: list[str] = []
        self._event = asyncio.Event()

    def __call__(self, how: ExitStatus) -> None:
        self.reported.append(str(how))
        self._event.set()

    async def wait(self) -> list[str]:
        await asyncio.wait_for(self._event.wait(), 20.0)
        await asyncio.sleep(0)
        return self.reported


@pytest.mark.parametrize(("code", "how"), [("raise SystemExit(3)", "exit 3"), ("pass", "exit 0")])
async def test_exit_code_of_child_is_reported_once(code: str, how: str) -> None:
    ends = Ends()
    SupervisedProcess(StartedProcess(child(code)), ends)
    assert await ends.wait() == [how]


async def test_signal_reaches_process_and_is_its_status() -> None:
    ends = Ends()
    process = SupervisedProcess(StartedProcess(child()), ends)
    process.signal(signal.SIGKILL)
    assert await ends.wait() == ["signal 9"]


async def test_status_of_forked_process_comes_from_fork_server() -> None:
    ours, server = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    pid = child()
    ends = Ends()
    process = SupervisedProcess(StartedProcess(pid, ours), ends)
    process.signal(signal.SIGTERM)
    reap(pid)
    server.send(b"signal 15")
    assert await ends.wait() == ["signal 15"]
    assert ours.fileno() == -1, "closed with it"
    server.close()


async def test_status_without_fork_server_is_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(supervised_process, "ENDED_S", 0.01)
    ours, server = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    pid = child("pass")
    ends = Ends()
    SupervisedProcess(StartedProcess(pid, ours), ends)
    reap(pid)
    assert await ends.wait() == ["gone"]
    server.close()


async def test_process_that_does_not_run_is_not_found() -> None:
    pid = child("pass")
    reap(pid)
    with pytest.raises(NotFound, match=f"process {pid}: it does not run"):
        SupervisedProcess(StartedProcess(pid), Ends())


async def test_unwatched_process_continues_unreported() -> None:
    pid, ends = child(), Ends()
    process = SupervisedProcess(StartedProcess(pid), ends)
    process.close()
    os.kill(pid, 0)
    os.kill(pid, signal.SIGKILL)
    reap(pid)
    await asyncio.sleep(0)
    assert ends.reported == []
