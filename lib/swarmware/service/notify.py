"""Notifications of a process to its service manager (sd_notify), and the socket that receives them."""

from __future__ import annotations

import os

from swarmware.footprint.annotations import Final
from swarmware.footprint.plain import socket

_USEC: Final = 1_000_000
RECEIVE_BYTES: Final = 4096
"""A notification is one datagram of a few lines."""
_CREDENTIALS_BYTES: Final = 12
"""Three `int`: pid, uid, gid. Source: unix(7), SCM_CREDENTIALS."""


class Notifier:
    """Sends to the socket in NOTIFY_SOCKET; without one every notification is dropped."""

    def __init__(self, address: str | None = None, watchdog_usec: str | None = None) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "") if address is None else address
        watchdog_usec = os.environ.get("WATCHDOG_USEC", "") if watchdog_usec is None else watchdog_usec
        # a leading @ is an address without a file (unix(7), abstract)
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
        self.watchdog_s: float | None = int(watchdog_usec) / _USEC / 2 if watchdog_usec.isdigit() else None
        """Period of `alive`: half of the watchdog time of the service manager."""

    def ready(self, status: str) -> None:
        """Notify that the service is ready."""
        self._send(f"READY=1\nSTATUS={status}\nMAINPID={os.getpid()}")

    def alive(self) -> bool:
        """Reset the watchdog: the event loop runs. False when no process receives it."""
        return self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Set the line in `systemctl status`."""
        self._send(f"STATUS={text}")

    def restarted(self, count: int, reason: str) -> None:
        """Notify a restart of the supervised process."""
        self._send(f"STATUS=restart {count}: {reason}\nX_RESTARTS={count}\nX_REASON={reason}")

    def stopping(self) -> None:
        """Notify that the process stops on request."""
        self._send("STOPPING=1\nSTATUS=stopping")

    def close(self) -> None:
        """Close the socket to the supervisor."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, text: str) -> bool:
        if self._socket is None:
            return False
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:  # a service manager that has ended or is busy must not stop the service
            return False
        return True


class NotificationSocket:
    """Receives the notifications of processes of this user; other users' notifications are ignored."""

    def __init__(self, path: str = "") -> None:
        """`path`: path of the socket, or "" for an abstract address of the kernel's choice (unix(7)).

        Raises: OSError when it cannot be bound.
        """
        self._path = path
        self._inode = 0
        self._socket = self._bound()

    def _bound(self) -> socket.socket:
        if self._path:
            remove_file(self._path)
        kind = socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
        made = socket.socket(socket.AF_UNIX, kind)
        try:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
            made.bind(self._path)
            if self._path:
                self._inode = os.lstat(self._path).st_ino
        except OSError:
            made.close()
            raise
        return made

    @property
    def stands(self) -> bool:
        """Whether the file of the socket is at its path."""
        try:
            return not self._path or os.lstat(self._path).st_ino == self._inode
        except OSError:  # removed, or its folder
            return False

    def bind_again(self) -> None:
        """Bind a new socket to the path, whose file was removed. Raises: OSError."""
        former, self._socket = self._socket, self._bound()
        former.close()

    @property
    def address(self) -> str:
        """Value of NOTIFY_SOCKET for the processes that notify."""
        return self._path or "@" + self._socket.getsockname()[1:].decode()

    def fileno(self) -> int:
        """Descriptor of the socket, readable when a notification waits."""
        return self._socket.fileno()

    def receive(self) -> tuple[int, dict[str, str]] | None:
        """pid of the sender and the variables of its notification, or None if no notification waits."""
        while True:
            try:
                data, ancillary, _, _ = self._socket.recvmsg(
                    RECEIVE_BYTES, socket.CMSG_SPACE(_CREDENTIALS_BYTES)
                )
            except BlockingIOError:
                return None
            for level, kind, content in ancillary:
                if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
                    pid, uid, _gid = memoryview(content).cast("i")
                    if uid == os.getuid():
                        return pid, variables(data)

    def close(self) -> None:
        """Close the socket and remove its file."""
        if self._path:
            remove_file(self._path)
        self._socket.close()


def remove_file(path: str) -> None:
    """Remove the file at this path, if there is one."""
    try:
        os.unlink(path)
    except FileNotFoundError:
        pass


def variables(data: bytes) -> dict[str, str]:
    """The variables of a notification; a line without `=` is a name without a value."""
    return dict(line.partition("=")[::2] for line in data.decode("utf-8", "replace").splitlines())
