"""The socket on which the parent of a node receives notifications (sd_notify) of its processes."""

from __future__ import annotations

import os

from swarmware.errors import Conflict
from swarmware.service.fork import FOLDER, own_folder
from swarmware.service.notify import NotificationSocket
from swarmware.service.starting import PARENT_SOCKET
from swarmware.transport.shm.lock import lock_within

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from typing import Final

LOCK_WAIT_S: Final = 1.0
"""Wait for the lock of a killed parent: it is held until the kernel has ended that process."""


class Words(NotificationSocket):
    """Receives the notifications of one node; its lock keeps a second parent out."""

    def __init__(self, run_dir: str) -> None:
        """Raises: Conflict when the node has a parent already."""
        folder = own_folder(run_dir, FOLDER)
        self._lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        if not lock_within(self._lock, LOCK_WAIT_S):
            os.close(self._lock)
            raise Conflict(f"{run_dir}: `swarmd node` runs here already; expected one for each node")
        super().__init__(os.path.join(folder, PARENT_SOCKET))

    def close(self) -> None:
        """Close the socket and release its lock."""
        super().close()
        os.close(self._lock)
