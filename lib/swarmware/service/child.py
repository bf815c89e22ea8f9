"""A process of a service as its supervisor sees it: started here or found running, its end known at once."""

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable

from swarmware.errors import NotFound
from swarmware.service.fork import ENDED_S, Started


class Child:
    """One process. `on_exit` is called once, with `signal 9`, `exit 1`, or `gone` for another's child."""

    def __init__(self, started: Started, on_exit: Callable[[str], None]) -> None:
        """Raises: NotFound when there is no such process."""
        self._started = started
        self.pid = started.pid
        try:
            self._fd = os.pidfd_open(self.pid)
        except ProcessLookupError:
            started.close()
            raise NotFound(f"process {self.pid}: it does not run") from None
        self._on_exit = on_exit
        self._late: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._ended)

    def signal(self, number: signal.Signals) -> None:
        """Sends a signal to this very process, never to a later one with its number."""
        if self._fd >= 0:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._fd, number)

    def _ended(self) -> None:
        status = self._started.status
        if status is None:
            self._say()
        else:  # its parent, the fork server, learns how
            self._loop.remove_reader(self._fd)
            self._loop.add_reader(status, self._say)
            self._late = self._loop.call_later(ENDED_S, self._say)

    def _say(self) -> None:
        how = self._started.how()
        self.close()
        self._on_exit(how)

    def close(self) -> None:
        """Watch it no more; it goes on."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1
        if self._late is not None:
            self._late.cancel()
        if self._started.status is not None:
            self._loop.remove_reader(self._started.status)
        self._started.close()
