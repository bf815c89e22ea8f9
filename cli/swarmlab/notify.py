"""Notifications of nodes, ready or restarted: the receiving end of sd_notify, a socket for each."""

import re
import socket
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

_LIMIT: Final = 4096
"""sd_notify messages are one datagram of a few lines."""
_COUNT_DIGITS: Final = 6
"""A count of restarts with more digits is none."""


class Restarts(msgspec.Struct, frozen=True):
    """How often a node's supervisor has started its process again, and why."""

    count: int = 0
    reasons: tuple[str, ...] = ()
    """How each process before ended, oldest first: `signal 9`, `exit 1`, `gone`."""

    def __str__(self) -> str:
        times = "once" if self.count == 1 else f"{self.count} times"
        return f"restarted {times} ({', '.join(self.reasons) or 'no reason given'})"


class NotifySocket:
    """One node's notification socket, as systemd would offer it in NOTIFY_SOCKET."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ready = False
        """READY=1 was received and no RELOADING, STOPPING or restart after it."""
        self.status = ""
        """Newest STATUS= line."""
        self.restarts = Restarts()
        """Of all X_RESTARTS= and X_REASON= lines, and of supervisors that died."""
        self._before = 0
        """How many there were when the present supervisor began to count."""
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
        count, reason = 0, ""
        for line in data.decode("utf-8", "replace").splitlines():
            key, _, value = line.partition("=")
            if key == "READY" and value == "1":
                self.ready = True
            elif key in {"RELOADING", "STOPPING"} and value == "1":
                self.ready = False
            elif key == "STATUS":
                self.status = value
            elif key == "X_RESTARTS" and re.fullmatch(rf"[0-9]{{1,{_COUNT_DIGITS}}}", value):
                count = int(value)
            elif key == "X_REASON":
                reason = value
        if count and self._before + count > self.restarts.count:
            self._add(self._before + count, reason)

    def supervisor_died(self, how: str) -> None:
        """It is started again, and counts from the beginning."""
        self._add(self.restarts.count + 1, f"parent: {how}")
        self._before = self.restarts.count

    def _add(self, count: int, reason: str) -> None:
        self.restarts = Restarts(count, (*self.restarts.reasons, reason))
        self.ready = False

    def close(self) -> None:
        """Closes the socket; sd_notify of a node does not fail without it."""
        self._socket.close()
        with suppress(FileNotFoundError):
            self.path.unlink()
