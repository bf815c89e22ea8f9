"""The file lock: the holder of the `flock` of a file that is still at its path may change it.

The kernel releases the lock with the last descriptor, for any end of the process. Readers do not need it.
"""

from __future__ import annotations

import fcntl
import os
import time

from swarmware.footprint.annotations import Path

RETRY_S = 0.0005
"""Pause between two attempts. All holders but the owner of a ring keep a lock for some ten microseconds."""


def try_lock(fd: int, *, shared: bool = False) -> bool:
    """Take the exclusive or the shared lock if it is free; returns whether it was."""
    try:
        fcntl.flock(fd, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def lock_within(fd: int, timeout_s: float, *, shared: bool = False) -> bool:
    """Take the exclusive or the shared lock, waiting for short holders, at most for the time-out.

    A blocking `flock` would wait without limit for a stopped holder (SIGSTOP, debugger).
    """
    deadline_s = time.monotonic() + timeout_s
    while not try_lock(fd, shared=shared):
        if time.monotonic() >= deadline_s:
            return False
        time.sleep(RETRY_S)
    return True


def held_by_other(fd: int) -> bool:
    """Whether another open file has the exclusive lock; takes and returns a shared one to find out."""
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    fcntl.flock(fd, fcntl.LOCK_UN)
    return False


def stands_at(fd: int, path: Path | str) -> bool:
    """Whether the open file is still the one found at the path, not unlinked and not renamed over."""
    try:
        found = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    mine = os.fstat(fd)
    return (found.st_dev, found.st_ino) == (mine.st_dev, mine.st_ino)
