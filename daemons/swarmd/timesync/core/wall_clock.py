"""Steps of the computer's wall clock, measured against the node's clock, which is never set."""

from typing import Final

import msgspec

STEP_NS: Final = 128_000_000
"""Smallest step. Source: RFC 5905, STEPT: time services correct smaller differences gradually."""
SHOWN_NS: Final = 60_000_000_000
"""Time for which a step is a fault: long enough for an operator who looks once a minute."""
LATE_NS: Final = 20_000_000
"""Longest time between two readings of the node's clock around one of the wall clock; a process that was
interrupted between them knows neither instant."""


class WallClockStep(msgspec.Struct, frozen=True):
    """The last step of the wall clock."""

    step_s: float = 0.0
    """Positive: the wall clock was set forward; 0: no step within the last minute."""


class WallClock:
    """Finds steps of the wall clock between two looks."""

    def __init__(self) -> None:
        self._apart_ns: int | None = None
        """Wall clock minus node clock at the last look, or None before the first one."""
        self._step_ns = 0
        self._stepped_ns = 0
        """Instant of the last step on the node's clock."""

    def on_look(self, before_ns: int, wall_ns: int, after_ns: int) -> WallClockStep:
        """Takes a reading of the wall clock between two of the node's clock.

        A computer that slept has a step, too: its monotonic clock stands meanwhile.
        """
        if after_ns - before_ns <= LATE_NS:
            apart_ns = wall_ns - (before_ns + after_ns) // 2
            if self._apart_ns is not None and abs(apart_ns - self._apart_ns) >= STEP_NS:
                self._step_ns, self._stepped_ns = apart_ns - self._apart_ns, after_ns
            self._apart_ns = apart_ns
        is_shown = self._step_ns != 0 and after_ns - self._stepped_ns < SHOWN_NS
        return WallClockStep(round(self._step_ns / 1e9, 3) if is_shown else 0.0)
