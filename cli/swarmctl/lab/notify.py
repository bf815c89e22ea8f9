"""How nodes say that they are ready: the receiving end of sd_notify, one socket for each node."""

import socket
from contextlib import suppress
from pathlib import Path
from typing import Final

_LIMIT: Final = 4096
"""sd_notify messages are one datagram of a few lines."""


class NotifySocket:
    """One node's notification socket, as systemd would offer it in NOTIFY_SOCKET."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ready = False
        """READY=1 was heard and no RELOADING or STOPPING after it."""
        self.status = ""
        """Newest STATUS= line."""
        with suppress(FileNotFoundError):
            path.unlink()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.bind(str(path))

    def fileno(self) -> int:
        """For the event loop."""
        return self._socket.fileno()

    def drain(self) -> None:
        """Takes in everything that has arrived."""
        while True:
            try:
                data = self._socket.recv(_LIMIT)
            except BlockingIOError:
                return
            self.take(data)

    def take(self, data: bytes) -> None:
        """One message; unknown lines are passed over, as systemd does."""
        for line in data.decode("utf-8", "replace").splitlines():
            key, _, value = line.partition("=")
            if key == "READY" and value == "1":
                self.ready = True
            elif key in {"RELOADING", "STOPPING"} and value == "1":
                self.ready = False
            elif key == "STATUS":
                self.status = value

    def close(self) -> None:
        """Nobody listens from here on; senders do not mind."""
        self._socket.close()
        with suppress(FileNotFoundError):
            self.path.unlink()
