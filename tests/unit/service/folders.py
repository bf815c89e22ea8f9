"""Folders that a node must not damage."""

import fcntl
import os
from pathlib import Path


def is_left_alone(folder: Path) -> bool:
    """Whether a cleaner, which takes a shared lock of each folder that it enters, must leave it."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(fd)
    return False
