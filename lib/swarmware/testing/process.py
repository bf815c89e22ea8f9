"""Real processes of a test: starts them, reads their output, and always ends them."""

import asyncio
import contextlib
import os
import signal
import sys
import tempfile
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from swarmware.errors import NoAnswer, SwarmError
from swarmware.service.notify import NotificationSocket
from swarmware.testing.forked import ForkedChild, fork_server

READY_S = 60.0
"""Time-out for the start of a process on a loaded machine, in seconds."""
END_S = 60.0


class Process:
    """One child process; its standard error is kept for the message of a failure."""

    def __init__(self, child: asyncio.subprocess.Process | ForkedChild, errors: Path, what: str) -> None:
        self._child = child
        self._errors = errors
        self._what = what

    @property
    def pid(self) -> int:
        """Number of the child process."""
        return self._child.pid

    @property
    def returncode(self) -> int | None:
        """Exit code, or None while it runs."""
        return self._child.returncode

    def stderr(self) -> str:
        """Standard error output of the process so far."""
        return self._errors.read_text("utf-8", "replace")

    async def line(self, timeout_s: float = READY_S) -> str:
        """Wait for the next line of its standard output.

        Raises: NoAnswer when none arrives within the time-out, or the process has ended.
        """
        assert self._child.stdout is not None
        try:
            line = await asyncio.wait_for(self._child.stdout.readline(), timeout_s)
        except TimeoutError:
            raise NoAnswer(f"{self._what}: no line within {timeout_s} s\n{self.stderr()}") from None
        if not line:
            raise NoAnswer(f"{self._what}: ended\n{self.stderr()}")
        return line.decode().rstrip("\n")

    def signal(self, number: int) -> None:
        """Send a signal to the child process."""
        self._child.send_signal(number)

    async def wait(self, timeout_s: float = END_S) -> int:
        """Wait for the end of the process; returns its exit code.

        Raises: NoAnswer when it does not end in time.
        """
        try:
            return await asyncio.wait_for(self._child.wait(), timeout_s)
        except TimeoutError:
            raise NoAnswer(f"{self._what}: still runs after {timeout_s} s\n{self.stderr()}") from None

    async def terminate(self) -> int:
        """Send SIGTERM; returns the exit code."""
        self.signal(signal.SIGTERM)
        return await self.wait()

    async def kill(self) -> None:
        """Send SIGKILL and wait for the end of the process."""
        self.signal(signal.SIGKILL)
        await self.wait()

    async def end(self) -> None:
        """End the process by SIGTERM, or by SIGKILL when it does not react."""
        for end in (self.terminate, self.kill):
            if self._child.returncode is None:
                with contextlib.suppress(ProcessLookupError, NoAnswer):
                    await end()


@asynccontextmanager
async def run_python(*args: str, env: Mapping[str, str] | None = None) -> AsyncIterator[Process]:
    """A Python process with these arguments, which ends with the block."""
    with _errors() as errors:
        child = await asyncio.create_subprocess_exec(
            sys.executable,
            *args,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=errors,
            env={**os.environ, **(env or {})},
        )
        process = Process(child, Path(errors.name), " ".join(args))
        try:
            yield process
        finally:
            await process.end()
            # the transport of the pipe closes in a later turn of the loop; left open it warns
            transport = getattr(child, "_transport", None)
            if transport is not None:
                transport.close()
            await asyncio.sleep(0)


@asynccontextmanager
async def spawn(
    config_dir: Path,
    *names: str,
    ready_s: float = READY_S,
    env: Mapping[str, str] | None = None,
    forked: bool = True,
) -> AsyncIterator[Process]:
    """Run `swarmd run NAMES`, or `swarmd node` without names; enter the block at READY, end it by SIGTERM.

    The services are forked if the test has a fork server (`swarmware.testing.forked`), unless `forked` is
    false or `env` has variables, which a new interpreter may read.

    Raises: SwarmError when it ends before it is ready, or takes too long.
    """
    with contextlib.closing(NotificationSocket()) as notifications:
        variables = {**(env or {}), "NOTIFY_SOCKET": notifications.address}
        started = _services(config_dir, names, variables, forked=forked and not env)
        async with started as process:
            await _ready(process, notifications, ready_s)
            yield process


@asynccontextmanager
async def _services(
    config_dir: Path, names: Sequence[str], variables: Mapping[str, str], *, forked: bool
) -> AsyncIterator[Process]:
    args = ["-m", "swarmd", *(["run", *names] if names else ["node"]), "--config", str(config_dir)]
    if forked and names and (server := fork_server(names)) is not None:
        with _errors() as errors:
            everything = {**os.environ, **variables}
            async with server.child(names, config_dir, everything, errors.fileno()) as child:
                if child is not None:
                    process = Process(child, Path(errors.name), " ".join(args))
                    try:
                        yield process
                    finally:
                        await process.end()
                    return
    async with run_python(*args, env=variables) as process:
        yield process


def _errors() -> "tempfile._TemporaryFileWrapper[bytes]":
    return tempfile.NamedTemporaryFile(prefix="swarm-test-", suffix=".err")


async def _ready(process: Process, notifications: NotificationSocket, timeout_s: float) -> None:
    loop, ready = asyncio.get_running_loop(), asyncio.Event()

    def receive() -> None:
        while (found := notifications.receive()) is not None:
            if found[1].get("READY") == "1":
                ready.set()

    loop.add_reader(notifications.fileno(), receive)
    ended = asyncio.ensure_future(process.wait(timeout_s))
    started = asyncio.ensure_future(ready.wait())
    try:
        await asyncio.wait([started, ended], return_when=asyncio.FIRST_COMPLETED)
        if not ready.is_set():
            code = ended.result()
            raise SwarmError(f"swarmd ended with {code} before it was ready\n{process.stderr()}")
    finally:
        loop.remove_reader(notifications.fileno())
        started.cancel()
        ended.cancel()
        with contextlib.suppress(asyncio.CancelledError, NoAnswer):
            await ended
