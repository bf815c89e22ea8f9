"""The socket on which the parent of a node receives notifications (sd_notify) of its processes."""

from __future__ import annotations

import os
import socket
import struct
from contextlib import suppress

from swarmware.errors import Conflict
from swarmware.service.fork import FOLDER, own_folder
from swarmware.service.starting import PARENT_SOCKET
from swarmware.transport.shm.lock import lock_within

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from typing import Final

RECEIVE_BYTES: Final = 4096
LOCK_WAIT_S: Final = 1.0
"""Wait for the lock of a killed parent: it is held until the kernel has ended that process."""
_CREDENTIALS: Final = struct.Struct("3i")
"""pid, uid, gid. Source: unix(7), SCM_CREDENTIALS."""


class Words:
    """Receives notifications in the format of systemd; those of other users are ignored."""

    def __init__(self, run_dir: str) -> None:
        """Raises: Conflict when the node has a parent already."""
        folder = own_folder(run_dir, FOLDER)
        self._lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        if not lock_within(self._lock, LOCK_WAIT_S):
            os.close(self._lock)
            raise Conflict(f"{run_dir}: `swarmd node` runs here already; expected one for each node")
        self._path = os.path.join(folder, PARENT_SOCKET)
        with suppress(FileNotFoundError):
            os.unlink(self._path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind(self._path)

    def fileno(self) -> int:
        """File descriptor of the socket, for `poll`."""
        return self._socket.fileno()

    def take(self) -> tuple[int, dict[str, str]] | None:
        """pid of the sender and the variables of its notification; None when none is waiting."""
        while True:
            try:
                data, ancillary, _, _ = self._socket.recvmsg(
                    RECEIVE_BYTES, socket.CMSG_SPACE(_CREDENTIALS.size)
                )
            except BlockingIOError:
                return None
            for level, kind, content in ancillary:
                if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
                    pid, uid, _gid = _CREDENTIALS.unpack(content)
                    if uid == os.getuid():
                        lines = data.decode("utf-8", "replace").splitlines()
                        return pid, dict(line.partition("=")[::2] for line in lines)

    def close(self) -> None:
        """Close the socket and release its lock."""
        with suppress(FileNotFoundError):
            os.unlink(self._path)
        self._socket.close()
        os.close(self._lock)
