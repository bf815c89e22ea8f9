"""Detector of steps of the computer's wall clock, relative to the node's clock, which is never set."""

from typing import Final

import msgspec

STEP_NS: Final = 128_000_000
"""Minimum size of a step; time services correct smaller differences gradually. Source: RFC 5905, STEPT."""
SHOWN_NS: Final = 60_000_000_000
"""Time for which a step counts as a fault, long enough for an operator who checks once a minute."""
LATE_NS: Final = 20_000_000
"""Maximum time between the two readings of the node's clock around a reading of the wall clock. A longer time
means that the process was interrupted, and that the three readings do not belong together."""


class WallClockStep(msgspec.Struct, frozen=True):
    """The last step of the wall clock."""

    step_s: float = 0.0
    """Size of the step, positive if the clock was set forward, or 0 without a step in the last minute."""


class WallClock:
    """Finds steps of the wall clock between two readings."""

    def __init__(self) -> None:
        self._apart_ns: int | None = None
        """Wall clock minus node clock at the last reading, or None before the first reading."""
        self._step_ns = 0
        self._stepped_ns = 0
        """Instant of the last step on the node's clock."""

    def on_look(self, before_ns: int, wall_ns: int, after_ns: int) -> WallClockStep:
        """Takes a reading of the wall clock, and the readings of the node's clock before and after it.

        A suspended computer shows a step as well, because its monotonic clock stops during the suspension.
        """
        if after_ns - before_ns <= LATE_NS:
            apart_ns = wall_ns - (before_ns + after_ns) // 2
            if self._apart_ns is not None and abs(apart_ns - self._apart_ns) >= STEP_NS:
                self._step_ns, self._stepped_ns = apart_ns - self._apart_ns, after_ns
            self._apart_ns = apart_ns
        is_shown = self._step_ns != 0 and after_ns - self._stepped_ns < SHOWN_NS
        return WallClockStep(round(self._step_ns / 1e9, 3) if is_shown else 0.0)
