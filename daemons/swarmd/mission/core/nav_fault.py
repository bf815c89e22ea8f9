"""Time-outs of errors that the navigator reports, and the errors with which its motion then fails."""

from collections.abc import Mapping
from typing import Final

from swarmware.types.navigation import NavError, NavState, NavStatus

KINDS: Final[dict[NavError, str]] = {
    NavError.NONE: "blocked",
    NavError.DISARMED: "disarmed",
    NavError.LEADER_LOST: "leader_lost",
    NavError.NO_POSITION: "no_position",
    NavError.NO_WAY: "blocked",
    NavError.BAD_GOAL: "blocked",
}
"""Kind of a block's error, by the navigator's error; an error unknown to this version counts as NONE."""
DEFAULT_S: Final[dict[NavError, float]] = {
    NavError.NONE: 0.0,
    NavError.DISARMED: 1.0,
    NavError.BAD_GOAL: 0.0,
}
"""Timeouts where the settings give none: the report of arming may be delayed; an invalid goal stays
invalid."""


class NavFaultTimeouts:
    """Timeouts of the navigator's errors during one motion."""

    def __init__(self, limits_s: Mapping[NavError, float]) -> None:
        self._limits_s = {**DEFAULT_S, **limits_s}
        self._since: tuple[NavError, int] | None = None

    def reset(self) -> None:
        """Restarts the timeouts: earlier reports of the navigator do not count."""
        self._since = None

    def lost(self, status: NavStatus, now_ns: int) -> tuple[str, str] | None:
        """Kind and text of the error when it has lasted longer than its timeout."""
        error = status.error
        # a blocked navigator without a named error makes no progress either, which has a timeout too
        if error is NavError.NONE and status.state is not NavState.BLOCKED:
            self._since = None
            return None
        if self._since is None or self._since[0] != error:
            self._since = (error, now_ns)
        if now_ns - self._since[1] < self._limits_s.get(error, self._limits_s[NavError.NONE]) * 1e9:
            return None
        words = [word for word in (error.value, status.note) if word]
        return KINDS.get(error, KINDS[NavError.NONE]), ": ".join(words) or "the navigator makes no progress"
