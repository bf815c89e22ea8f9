"""A running process by its pidfd: it names this process, never a later one with the same number.

The parent of a node's processes imports this module, so it imports as few modules as possible.
"""

from __future__ import annotations

import errno
import os

from swarmware.footprint.plain import signal

_STATE, _START = 0, 19
"""Positions of state (field 3) and starttime (field 22) behind the command name. Source: proc_pid_stat(5)."""

_DEAD_STATES = frozenset("ZXx")
"""States of a process that executes no code any more, such as a zombie."""


class ProcessHandle:
    """One running process, child or not: its end can be polled, and it takes signals."""

    __slots__ = ("_fd", "pid")

    def __init__(self, pid: int, started: int = 0) -> None:
        """`started`: start, in clock ticks, of the process that had this pid when the pid was read;
        0: it cannot have ended since then, as a child of this process that was not waited for.

        Raises: ProcessLookupError when that process has ended, OSError when it cannot be watched from here.
        """
        self.pid = pid
        self._fd = os.pidfd_open(pid)
        if started and start_ticks(pid) != started:  # after the opening: the handle cannot change its process
            self.close()
            raise ProcessLookupError(errno.ESRCH, f"process {pid}: it has ended, a later one has its pid")

    def fileno(self) -> int:
        """Descriptor that is readable when the process has ended; -1 after `close`."""
        return self._fd

    def signal(self, number: int) -> None:
        """Send a signal; no effect on a process that has ended.

        Raises: PermissionError for a process of another user.
        """
        if self._fd >= 0:
            try:
                signal.pidfd_send_signal(self._fd, number)
            except ProcessLookupError:
                pass

    def close(self) -> None:
        """Close the descriptor; the process continues."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def start_ticks(pid: int) -> int:
    """When the process started, in clock ticks since boot, or 0 if it does not run.

    The command name may hold blanks and parentheses: fields count from the last ')'.
    Source: proc_pid_stat(5).
    """
    if not 0 < pid <= 0x7FFF_FFFF:
        return 0
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:
            fields = file.read().rpartition(b")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    if len(fields) <= _START or fields[_STATE].decode("ascii", "replace") in _DEAD_STATES:
        return 0
    return int(fields[_START])


def lives(pid: int, started: int) -> bool:
    """Whether the process with this pid that started at this instant still executes code.

    Units: `started` in clock ticks since boot, as of `start_ticks`.
    """
    return start_ticks(pid) == started != 0
