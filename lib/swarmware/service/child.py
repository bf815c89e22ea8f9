"""A process of a service as its supervisor sees it: started here or found running, its end known at once."""

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable

from swarmware.errors import NotFound


class Child:
    """One process. `on_exit` is called once, with `signal 9`, `exit 1`, or `gone` for another's child."""

    def __init__(self, pid: int, on_exit: Callable[[str], None]) -> None:
        """Raises: NotFound when there is no such process."""
        try:
            self._fd = os.pidfd_open(pid)
        except ProcessLookupError:
            raise NotFound(f"process {pid}: it does not run") from None
        self.pid = pid
        self._on_exit = on_exit
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._ended)

    def signal(self, number: signal.Signals) -> None:
        """Sends a signal to this very process, never to a later one with its number."""
        if self._fd >= 0:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._fd, number)

    def _ended(self) -> None:
        how = "gone"
        with contextlib.suppress(
            ChildProcessError
        ):  # a child of another process: that one learns how it ended
            result = os.waitid(os.P_PIDFD, self._fd, os.WEXITED | os.WNOHANG)
            if result is not None:
                how = f"{'exit' if result.si_code == os.CLD_EXITED else 'signal'} {result.si_status}"
        self.close()
        self._on_exit(how)

    def close(self) -> None:
        """Watch it no more; it goes on."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1
