"""Notifications to the service manager of this process (sd_notify): ready, watchdog, status, stopping."""

from __future__ import annotations

import os
import socket
from contextlib import suppress

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from typing import Final

_USEC: Final = 1_000_000


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

    def alive(self) -> None:
        """Reset the watchdog: the event loop runs."""
        self._send("WATCHDOG=1")

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

    def _send(self, text: str) -> None:
        if self._socket is not None:
            # a service manager that has ended or is busy must not stop the service
            with suppress(OSError):
                self._socket.sendto(text.encode(), self._address)
