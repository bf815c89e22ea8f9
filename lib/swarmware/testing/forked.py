"""A fork server for tests: most processes of services are forks of it, in a tenth of the processor time.

Each is what `swarmd run NAMES` is, but for the import of its code, which the server has done once.
"""

import asyncio
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, closing, contextmanager, suppress
from pathlib import Path
from typing import IO, Final

from swarmware.errors import NoAnswer, SwarmError
from swarmware.runtime.pidfd import ProcessHandle
from swarmware.service.fork_client import StartedProcess, request_fork_of
from swarmware.service.installed import installed
from swarmware.service.notify import NotificationSocket
from swarmware.testing.leaks import FORK_SERVERS, children

START_S: Final = 60.0
"""Time-out for the start of the server, for a fork, and for the end after SIGKILL, on a loaded machine."""
LEFT_S: Final = 10.0
"""Time-out for the end of its last process when all tests have ended."""
OURS: Final = "swarmd."
"""The server runs daemons of this package: an import of another one may start threads."""


class ForkedChild:
    """A process that the fork server has forked, with the methods of `asyncio.subprocess.Process`."""

    def __init__(self, started: StartedProcess, stdout: asyncio.StreamReader) -> None:
        assert started.status is not None
        self.pid = started.pid
        self.returncode: int | None = None
        """Exit code, negative number of the signal that ended it, or None while it runs."""
        self.stdout: asyncio.StreamReader | None = stdout
        self._started = started
        self._ended = asyncio.Event()
        self._handle: ProcessHandle | None = None
        with suppress(ProcessLookupError):  # it has ended, and its exit status is on its way
            self._handle = ProcessHandle(started.pid)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(started.status, self._on_status)

    def _on_status(self) -> None:
        """The exit status has arrived, or the server has ended, with which the process ends as well."""
        assert self._started.status is not None
        self._loop.remove_reader(self._started.status)
        found = self._started.exit_status()
        if not found.known:
            self.send_signal(signal.SIGKILL)
        self.returncode = -(found.signal or signal.SIGKILL) if found.code is None else found.code
        self._ended.set()

    def send_signal(self, number: int) -> None:
        """Send a signal to this process, never to a later one with the same pid.

        Raises: ProcessLookupError when it is known to have ended.
        """
        if self.returncode is not None:
            raise ProcessLookupError(f"process {self.pid}: it has ended")
        if self._handle is not None:
            self._handle.signal(number)

    async def wait(self) -> int:
        """Wait for its end; returns its exit code."""
        await self._ended.wait()
        assert self.returncode is not None
        return self.returncode

    def close(self) -> None:
        """Release what belongs to this process; it continues."""
        if self._started.status is not None:
            self._loop.remove_reader(self._started.status)
        self._started.close()
        if self._handle is not None:
            self._handle.close()


class ForkServerProcess:
    """The fork server, a child of this process, with all daemons imported; it ends with this process."""

    def __init__(self, services: Sequence[str] = ()) -> None:
        """`services`: that it imports; all of this package unless they are given.

        Raises: SwarmError when it is not ready in time.
        """
        ours = sorted(name for name, point in installed().items() if point.value.startswith(OURS))
        self._services = tuple(services or ours)
        self._folder = tempfile.TemporaryDirectory(prefix="swarm-forks-")
        self.socket = str(Path(self._folder.name) / "socket")
        """File of the socket to which requests are sent."""
        self._errors: IO[bytes] = (Path(self._folder.name) / "errors").open("w+b")
        words = [sys.executable, "-m", "swarmd", "forkserver", *self._services, "--socket", self.socket]
        with closing(NotificationSocket()) as notifications:
            self._server = subprocess.Popen(
                [*words, "--shared"],
                stdin=subprocess.PIPE,  # it ends when this process does, and no test finds it
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                env={**os.environ, "NOTIFY_SOCKET": notifications.address},
                start_new_session=True,  # an interrupt from the keyboard is for the tests, which end the rest
            )
            with closing(ProcessHandle(self._server.pid)) as ended:
                select.select([notifications.fileno(), ended.fileno()], [], [], START_S)
            is_ready = notifications.receive() is not None
        if not is_ready:
            text = self._log()
            self._server.kill()
            self._release()
            raise SwarmError(f"fork server: it did not become ready within {START_S} s, or has ended\n{text}")
        FORK_SERVERS.add(self.pid)

    @property
    def pid(self) -> int:
        """Number of the server's process."""
        return self._server.pid

    def has(self, names: Sequence[str]) -> bool:
        """Whether the server runs and has imported all of these services."""
        return set(names) <= set(self._services) and self._server.poll() is None

    @asynccontextmanager
    async def child(
        self, names: Sequence[str], config_dir: Path, variables: Mapping[str, str], errors: int
    ) -> AsyncIterator[ForkedChild | None]:
        """A process of these services with this environment, and this descriptor for its errors.

        It is not ended with the block. Returns None if the server does not answer.
        """
        loop, stdout = asyncio.get_running_loop(), asyncio.StreamReader()
        reading, writing = os.pipe()
        try:
            output = os.fdopen(reading, "rb", 0)
            transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdout), output)
            # without a pause from here to the child: a process that was requested always has an owner
            started = request_fork_of(
                self.socket,
                list(names),
                config_dir,
                dict(variables),
                shared=True,
                output=writing,
                errors=errors,
                answer_s=START_S,
            )
        finally:
            os.close(writing)
        try:
            if started is None:
                yield None
            else:
                with closing(ForkedChild(started, stdout)) as child:
                    yield child
        finally:
            transport.close()
            await asyncio.sleep(0)  # it closes in a later turn of the loop; left open it warns

    def close(self) -> None:
        """End the server.

        Raises: NoAnswer when a process of its has not ended: a test has left it.
        """
        self._hang_up()
        try:
            self._server.wait(LEFT_S)
        except subprocess.TimeoutExpired:
            left = children(self.pid)
            for pid in left:
                with closing(ProcessHandle(pid)) as handle:
                    handle.signal(signal.SIGKILL)
            raise NoAnswer(f"processes that tests have left: {sorted(left)}\n{self._log()}") from None
        finally:
            self._release()

    def _hang_up(self) -> None:
        assert self._server.stdin is not None
        self._server.stdin.close()

    def _release(self) -> None:
        self._hang_up()
        self._server.wait(START_S)
        FORK_SERVERS.discard(self.pid)
        self._errors.close()
        self._folder.cleanup()

    def _log(self) -> str:
        return (Path(self._folder.name) / "errors").read_text("utf-8", "replace")


_servers: Final[list[ForkServerProcess]] = []


@contextmanager
def forking(services: Sequence[str] = ()) -> Iterator[ForkServerProcess]:
    """A fork server, which `swarmware.testing.process.spawn` uses until the block ends.

    Raises: NoAnswer at the end of the block when a process of its has not ended.
    """
    server = ForkServerProcess(services)
    _servers.append(server)
    try:
        yield server
    finally:
        _servers.remove(server)
        server.close()


def fork_server(names: Sequence[str]) -> ForkServerProcess | None:
    """The fork server of this process with all of these services."""
    return _servers[-1] if _servers and _servers[-1].has(names) else None
