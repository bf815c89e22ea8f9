"""A process of a service as its supervisor sees it: started here or found running, its end known at once."""

import asyncio
import signal
from collections.abc import Callable

from swarmware.errors import NotFound
from swarmware.runtime.processes import WatchedProcess
from swarmware.service.fork import ENDED_S, Started


class Child:
    """One process. `on_exit` is called once, with `signal 9`, `exit 1`, or `gone` for another's child."""

    def __init__(self, started: Started, on_exit: Callable[[str], None]) -> None:
        """Raises: NotFound when there is no such process."""
        self._started = started
        self.pid = started.pid
        try:
            self._process = WatchedProcess(self.pid, self._ended)
        except ProcessLookupError:
            started.close()
            raise NotFound(f"process {self.pid}: it does not run") from None
        self._on_exit = on_exit
        self._late: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to this very process, never to a later one with its number."""
        self._process.signal(number)

    def _ended(self) -> None:
        status = self._started.status
        if status is None:
            self._report()
        else:  # its parent, the fork server, learns how
            self._loop.add_reader(status, self._report)
            self._late = self._loop.call_later(ENDED_S, self._report)

    def _report(self) -> None:
        how = self._started.how()
        self.close()
        self._on_exit(how)

    def close(self) -> None:
        """Stop watching; the process goes on."""
        self._process.close()
        if self._late is not None:
            self._late.cancel()
        if self._started.status is not None:
            self._loop.remove_reader(self._started.status)
        self._started.close()
