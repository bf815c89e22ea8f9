"""Receives notifications (sd_notify) of nodes: one socket for each node."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from swarmware.service.notify import NotificationSocket

_COUNT_DIGITS: Final = 6
"""Maximum digits of a restart count; a longer one is invalid."""


class Restarts(msgspec.Struct, frozen=True):
    """Restarts of a node's process by its supervisor, with the reasons."""

    count: int = 0
    reasons: tuple[str, ...] = ()
    """How each former process ended, oldest first: `signal 9`, `exit 1`, `gone`."""

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
        """Restarts from X_RESTARTS= and X_REASON= lines, and of supervisors that died."""
        self._before = 0
        """Number of restarts before the present supervisor began to count."""
        self._socket = NotificationSocket(str(path))

    def fileno(self) -> int:
        """File descriptor of the socket, for the event loop."""
        return self._socket.fileno()

    def drain(self) -> None:
        """Processes all received messages."""
        while (found := self._socket.receive()) is not None:
            self.take(found[1])

    def take(self, variables: Mapping[str, str]) -> None:
        """Takes the variables of one notification; unknown ones are ignored, as systemd does."""
        if variables.get("READY") == "1":
            self.ready = True
        if "1" in {variables.get("RELOADING"), variables.get("STOPPING")}:
            self.ready = False
        self.status = variables.get("STATUS", self.status)
        restarts = variables.get("X_RESTARTS", "")
        count = int(restarts) if re.fullmatch(rf"[0-9]{{1,{_COUNT_DIGITS}}}", restarts) else 0
        # a count may be repeated, and only a larger one is a restart
        if count and self._before + count > self.restarts.count:
            self._add(self._before + count, variables.get("X_REASON", ""))

    def supervisor_died(self, how: str) -> None:
        """The supervisor died: it is restarted, and counts from the beginning."""
        self._add(self.restarts.count + 1, f"parent: {how}")
        # the next supervisor counts from 1, so its count is added to all restarts up to now
        self._before = self.restarts.count

    def _add(self, count: int, reason: str) -> None:
        self.restarts = Restarts(count, (*self.restarts.reasons, reason))
        self.ready = False

    def close(self) -> None:
        """Closes the socket; sd_notify of a node does not fail without it."""
        self._socket.close()
