"""Deaths of processes, told within milliseconds: one pidfd each, on the event loop."""

import asyncio
import os
from collections.abc import Callable, Set


class ProcessWatcher:
    """Watches the processes that run applications; `on_death` gets the pid, once."""

    def __init__(self, on_death: Callable[[int], None]) -> None:
        self._on_death = on_death
        self._loop = asyncio.get_running_loop()
        self._fds: dict[int, int] = {}

    def watch(self, pids: Set[int]) -> None:
        """These and no others, this process excepted."""
        wanted = pids - {os.getpid()}
        for pid in self._fds.keys() - wanted:
            self._forget(pid)
        for pid in wanted - self._fds.keys():
            try:
                fd = os.pidfd_open(pid)
            except ProcessLookupError:
                self._loop.call_soon(self._on_death, pid)
                continue
            except OSError:
                continue  # of another PID namespace: its lock tells when somebody looks
            self._fds[pid] = fd
            self._loop.add_reader(fd, self._died, pid)

    def _died(self, pid: int) -> None:
        self._forget(pid)
        self._on_death(pid)

    def _forget(self, pid: int) -> None:
        fd = self._fds.pop(pid)
        self._loop.remove_reader(fd)
        os.close(fd)

    def close(self) -> None:
        """Watch no more."""
        for pid in list(self._fds):
            self._forget(pid)
