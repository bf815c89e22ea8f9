"""Median filter: wrong echoes of a sonar are far off and rare."""

from collections import deque
from statistics import median


class MedianFilter:
    """Median of the last values (S2.49)."""

    __slots__ = ("_values",)

    def __init__(self, window: int) -> None:
        self._values: deque[float] = deque(maxlen=window)

    def add(self, value: float) -> float:
        """One more value; the median of the last ones, this one included."""
        self._values.append(value)
        return median(self._values)

    def reset(self) -> None:
        """Forget: what follows is unrelated to what was."""
        self._values.clear()
