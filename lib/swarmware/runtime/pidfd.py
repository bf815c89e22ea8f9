"""A running process by its pidfd: it names this process, never a later one with the same number.

The parent of a node's processes imports this, so it imports next to nothing.
"""

from __future__ import annotations

import os
import signal
from contextlib import suppress


class ProcessHandle:
    """One running process, child or not: its end can be polled, and it takes signals."""

    __slots__ = ("_fd", "pid")

    def __init__(self, pid: int) -> None:
        """Raises: ProcessLookupError without such a process, OSError when it cannot be watched from here."""
        self.pid = pid
        self._fd = os.pidfd_open(pid)

    def fileno(self) -> int:
        """Descriptor that is readable when the process has ended; -1 after `close`."""
        return self._fd

    def signal(self, number: signal.Signals) -> None:
        """Send a signal; one to a process that has ended is lost.

        Raises: PermissionError for a process of another user.
        """
        if self._fd >= 0:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._fd, number)

    def close(self) -> None:
        """Close the descriptor; the process continues."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
