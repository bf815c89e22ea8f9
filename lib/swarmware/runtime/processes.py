"""Running processes on the event loop: the end of each is reported once, within milliseconds."""

import asyncio
import os
import signal
from collections.abc import Callable, Set
from functools import partial

from swarmware.runtime.pidfd import ProcessHandle


class WatchedProcess:
    """One running process, child or not: reports its end, takes signals."""

    def __init__(self, pid: int, on_end: Callable[[], None], *, started: int = 0) -> None:
        """`started` as of a `ProcessHandle`.

        Raises: ProcessLookupError without such a process, OSError when it cannot be watched from here.
        """
        self.pid = pid
        self._handle = ProcessHandle(pid, started)
        self._on_end = on_end
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._handle.fileno(), self._ended)

    def _ended(self) -> None:
        self.close()
        self._on_end()

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to this process, never to a later one with the same pid."""
        self._handle.signal(number)

    def close(self) -> None:
        """Stop watching; the process continues."""
        if self._handle.fileno() >= 0:
            self._loop.remove_reader(self._handle.fileno())
            self._handle.close()


class ProcessWatcher:
    """Watches a changing set of processes; `on_end` gets the pid of each that ends."""

    def __init__(self, on_end: Callable[[int], None]) -> None:
        self._on_end = on_end
        self._loop = asyncio.get_running_loop()
        self._processes: dict[int, WatchedProcess] = {}
        self._reports: dict[int, asyncio.Handle | None] = {}
        """Processes whose end was reported while they are wanted; a handle where the report is scheduled."""

    def watch(self, pids: Set[int]) -> None:
        """Watch exactly these processes, without the own one."""
        wanted = pids - {os.getpid()}
        for pid in self._processes.keys() - wanted:
            self._processes.pop(pid).close()
        for pid in self._reports.keys() - wanted:
            if (report := self._reports.pop(pid)) is not None:
                report.cancel()
        for pid in wanted - self._processes.keys() - self._reports.keys():
            try:
                self._processes[pid] = WatchedProcess(pid, partial(self._ended, pid))
            except ProcessLookupError:
                # later, as for a process that ends: the caller is still setting up its watch
                self._reports[pid] = self._loop.call_soon(self._on_end, pid)
            except OSError:
                continue  # of another PID namespace: its end is only detected by its lock

    def _ended(self, pid: int) -> None:
        del self._processes[pid]
        self._reports[pid] = None
        self._on_end(pid)

    def close(self) -> None:
        """Stop watching all processes."""
        self.watch(frozenset())


async def process_end(pid: int) -> None:
    """Return when the process has ended.

    Raises: OSError when it cannot be watched: it has ended already, or no descriptor is free.
    """
    ended = asyncio.Event()
    process = WatchedProcess(pid, ended.set)
    try:
        await ended.wait()
    finally:
        process.close()
