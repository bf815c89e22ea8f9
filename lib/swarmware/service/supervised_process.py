"""A process of a service under supervision: started here or found running, with its exit status."""

import asyncio
import signal
from collections.abc import Callable

from swarmware.errors import NotFound
from swarmware.runtime.processes import WatchedProcess
from swarmware.service.exit_status import ExitStatus
from swarmware.service.fork_client import ENDED_S, StartedProcess


class SupervisedProcess:
    """Watches one process; `on_exit` is called once, with its exit status as far as it is known."""

    def __init__(self, started: StartedProcess, on_exit: Callable[[ExitStatus], None]) -> None:
        """Raises: NotFound if there is no such process."""
        self._started = started
        self.pid = started.pid
        try:
            self._process = WatchedProcess(self.pid, self._on_end, started=started.started)
        except ProcessLookupError:
            started.close()
            raise NotFound(f"process {self.pid}: it does not run") from None
        self._on_exit = on_exit
        self._status_timeout: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to this process, never to a later one with the same pid."""
        self._process.signal(number)

    def _on_end(self) -> None:
        status = self._started.status
        if status is None:
            self._report_exit()
        else:  # its parent, the fork server, reports the exit status
            self._loop.add_reader(status, self._report_exit)
            self._status_timeout = self._loop.call_later(ENDED_S, self._report_exit)

    def _report_exit(self) -> None:
        status = self._started.exit_status()
        self.close()
        self._on_exit(status)

    def close(self) -> None:
        """Stop watching; the process continues."""
        self._process.close()
        if self._status_timeout is not None:
            self._status_timeout.cancel()
        if self._started.status is not None:
            self._loop.remove_reader(self._started.status)
        self._started.close()
