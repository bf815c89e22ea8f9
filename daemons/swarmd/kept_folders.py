"""Folders that a cleaner of temporary files leaves alone while this process holds their locks.

systemd-tmpfiles, which removes files of /tmp after days, takes a shared lock of each folder before it enters
it, and skips the folder and everything below it where it cannot (tmpfiles.d(5)).
"""

from __future__ import annotations

import os

from swarmware.transport.shm.lock import stands_at, try_lock

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Final

KEEP_VARIABLE: Final = "SWARM_KEEP"
"""Environment variable with a further folder to keep, as that of a lab."""


class KeptFolders:
    """Holds the exclusive lock of each folder that no other process holds."""

    def __init__(self, folders: Sequence[str]) -> None:
        self._held: dict[str, int] = dict.fromkeys(folders, -1)
        self.tend()

    def tend(self) -> None:
        """Take the lock of a folder that was made again, or that another process held at the last attempt."""
        for folder, held in self._held.items():
            if held >= 0 and stands_at(held, folder):
                continue
            if held >= 0:
                os.close(held)
            self._held[folder] = _locked(folder)

    def close(self) -> None:
        """Release the locks of all folders."""
        for folder, held in self._held.items():
            if held >= 0:
                os.close(held)
                self._held[folder] = -1


def _locked(folder: str) -> int:
    """Descriptor of the locked folder; -1 while it is missing, or another process holds it."""
    try:
        fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:  # it is missing, or another user's: then it is not ours to keep
        return -1
    if try_lock(fd):
        return fd
    os.close(fd)
    return -1
