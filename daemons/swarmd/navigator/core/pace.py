"""Pace of a task whose steps follow a value that another computer sends."""

from typing import Final

_EARLY_RATIO: Final = 0.4
"""A value may arrive this part of a period before the next step is due: the delay of a link varies."""
_LATE_RATIO: Final = 1.5
"""Periods without a value after which a step is made without one."""

TURNS: Final = 2
"""Turns of a late event loop from a measurement to its use: its driver is delayed, then the navigator."""


class Pace:
    """Admits a step for each value, at about the rate of the task however often values arrive."""

    def __init__(self) -> None:
        self._due_ns = -(1 << 62)

    @staticmethod
    def wait_s(period_s: float) -> float:
        """Longest wait for the next value."""
        return period_s * _LATE_RATIO

    def take(self, now_ns: int, period_s: float) -> bool:
        """Whether a step is due now; the next one is due a period after the instant at which this one was."""
        period_ns = round(period_s * 1e9)
        early_ns = round(period_ns * _EARLY_RATIO)
        if now_ns < self._due_ns - early_ns:
            return False
        self._due_ns = max(self._due_ns + period_ns, now_ns + period_ns - early_ns)
        return True
