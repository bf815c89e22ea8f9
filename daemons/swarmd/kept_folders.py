"""Locks on folders, which keep systemd-tmpfiles from removing old files in them.

systemd-tmpfiles, which removes files of /tmp after days, takes a shared lock on each folder before it enters
the folder. A folder that another process has locked is skipped with all its content (tmpfiles.d(5)).
"""

from __future__ import annotations

import os

from swarmware.footprint.annotations import Final, Sequence
from swarmware.transport.shm.lock import stands_at, try_lock

KEEP_VARIABLE: Final = "SWARM_KEEP"
"""Environment variable with a further folder to keep, such as the folder of a lab."""


class KeptFolders:
    """Holds the exclusive lock of each folder, unless another process holds it."""

    def __init__(self, folders: Sequence[str]) -> None:
        self._held: dict[str, int] = dict.fromkeys(folders, -1)
        self.relock()

    def relock(self) -> None:
        """Lock each folder that was created again, or that another process held at the last attempt."""
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
    """Descriptor of the locked folder, or -1 while the folder is missing or locked by another process."""
    try:
        fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:  # missing, or the folder of another user, who then keeps it
        return -1
    if try_lock(fd):
        return fd
    os.close(fd)
    return -1
