"""Median filter: rejects rare outliers of a sonar."""

from collections import deque
from statistics import median


class MedianFilter:
    """Running median over a window of values (S2.49)."""

    __slots__ = ("_values",)

    def __init__(self, window: int) -> None:
        self._values: deque[float] = deque(maxlen=window)

    def add(self, value: float) -> float:
        """Adds a value; the median of the window, which includes it."""
        self._values.append(value)
        return median(self._values)

    def reset(self) -> None:
        """Clears the window: the next values are unrelated to the previous ones."""
        self._values.clear()
