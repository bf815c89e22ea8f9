"""Pace of a task whose steps follow the values that another computer sends."""

from typing import Final

_EARLY_RATIO: Final = 0.4
"""Ratio of a period by which a value may arrive before its step is due, because link delays vary."""
_LATE_RATIO: Final = 1.5
"""Number of periods without a value after which a step is made without a value."""

TURNS: Final = 2
"""Turns of a delayed event loop from a measurement to its use, in the driver and then in the navigator."""


class Pace:
    """Admits steps at about the rate of the task, however often values arrive."""

    def __init__(self) -> None:
        self._due_ns = -(1 << 62)

    @staticmethod
    def wait_s(period_s: float) -> float:
        """Maximum wait for the next value."""
        return period_s * _LATE_RATIO

    def take(self, now_ns: int, period_s: float) -> bool:
        """True if a step is due now, which also schedules the next step a period later."""
        period_ns = round(period_s * 1e9)
        early_ns = round(period_ns * _EARLY_RATIO)
        if now_ns < self._due_ns - early_ns:
            return False
        self._due_ns = max(self._due_ns + period_ns, now_ns + period_ns - early_ns)
        return True
