"""Median filter, which rejects rare outliers of a sonar."""

from collections import deque


class MedianFilter:
    """Running median over a window of values (S2.49)."""

    __slots__ = ("_values",)

    def __init__(self, window: int) -> None:
        self._values: deque[float] = deque(maxlen=window)

    def add(self, value: float) -> float:
        """Adds a value; returns the median of the window, which includes the value."""
        self._values.append(value)
        ordered = sorted(self._values)
        half = len(ordered) // 2
        return ordered[half] if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2

    def reset(self) -> None:
        """Clears the window before values that are unrelated to the previous ones."""
        self._values.clear()
