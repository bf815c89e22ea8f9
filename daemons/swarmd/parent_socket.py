"""The socket on which the parent of a node receives the notifications (sd_notify) of its processes."""

from __future__ import annotations

import os

from swarmware.errors import Conflict
from swarmware.footprint.annotations import Final
from swarmware.service.fork_client import FOLDER, own_folder
from swarmware.service.notify import NotificationSocket
from swarmware.service.starting import PARENT_SOCKET
from swarmware.transport.shm.lock import lock_within, stands_at

LOCK_WAIT_S: Final = 1.0
"""Maximum wait for the lock of a killed parent, which the kernel releases when the process has ended."""


class ParentSocket(NotificationSocket):
    """Receives the notifications of one node; a lock prevents a second parent."""

    def __init__(self, run_dir: str) -> None:
        """Raises: Conflict when the node has a parent already."""
        self._run_dir = run_dir
        self._lock = _locked(run_dir)
        super().__init__(os.path.join(run_dir, FOLDER, PARENT_SOCKET))

    def restore(self) -> bool:
        """Creates the socket again if its file was removed; returns True if so, when `fileno` has changed.

        A missing run directory is not created here, because a process of the node creates it with the right
        mode and group. Raises: OSError, Conflict.
        """
        if self.stands or not os.path.isdir(self._run_dir):
            return False
        if not stands_at(self._lock, os.path.join(self._run_dir, FOLDER)):
            former, self._lock = self._lock, _locked(self._run_dir)
            os.close(former)
        self.bind_again()
        return True

    def close(self) -> None:
        """Closes the socket and releases its lock."""
        super().close()
        os.close(self._lock)


def _locked(run_dir: str) -> int:
    """Descriptor of the locked folder of the parent. Raises: Conflict."""
    lock = os.open(own_folder(run_dir, FOLDER), os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    if not lock_within(lock, LOCK_WAIT_S):
        os.close(lock)
        raise Conflict(f"{run_dir}: `swarmd node` runs here already; expected one for each node")
    return lock
