"""Rates, sizes and delays of the values of one resource, over a sliding window."""

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import msgspec


class Statistics(msgspec.Struct, frozen=True):
    """Distribution of a quantity, each in the unit of its field."""

    min: float
    mean: float
    max: float
    std: float
    """Standard deviation."""


class Observation(NamedTuple):
    """One value as it arrived here."""

    sequence: int
    """Number of the value by its owner's counter."""
    stamp_ns: int
    """Stamp of the value on its owner's clock."""
    arrived_ns: int
    """Arrival on the clock of this node."""
    size_bytes: int = 0
    delay_s: float | None = None
    """Time from the stamp to the arrival, or None if the owner's clock is not known here."""


class RateMeter:
    """Observations of one resource within the last `window_s`, or of all time if it is None."""

    def __init__(self, window_s: float | None = None, *, numbered: bool = True) -> None:
        """`numbered`: the values have the numbers of their owner; else they were numbered on arrival."""
        self._numbered = numbered
        self.counted_hz: float | None = None
        """Rate by two readings of the owner's counter, for values without its numbers."""
        self._window_ns = None if window_s is None else round(window_s * 1e9)
        self._seen: deque[Observation] = deque()

    def add(self, seen: Observation) -> None:
        """Add one value; a restart of its owner discards the former ones."""
        # the counter falls only at a restart, and numbers of two runs have no common rate
        if self._seen and seen.sequence <= self._seen[-1].sequence:
            self._seen.clear()
        self._seen.append(seen)
        if self._window_ns is not None:
            # two values stay, however old, so that a slow resource still has a rate
            while len(self._seen) > 2 and seen.arrived_ns - self._seen[0].arrived_ns > self._window_ns:
                self._seen.popleft()

    def __len__(self) -> int:
        return len(self._seen)

    @property
    def span_s(self) -> float:
        """Time from the first to the last arrival."""
        return (self._seen[-1].arrived_ns - self._seen[0].arrived_ns) / 1e9 if self._seen else 0.0

    @property
    def written_hz(self) -> float | None:
        """Rate at which the owner writes, by its counter and clock, so that lost values count as well.

        None before the second value, or while its counter is not known.
        """
        if not self._numbered or len(self._seen) < 2:
            return self.counted_hz
        first, last = self._seen[0], self._seen[-1]
        return _rate(last.sequence - first.sequence, (last.stamp_ns - first.stamp_ns) / 1e9)

    @property
    def here_hz(self) -> float | None:
        """Rate of the arrivals, or None before the second value."""
        return _rate(len(self._seen) - 1, self.span_s)

    @property
    def intervals_s(self) -> Statistics | None:
        """Times between two arrivals, or None before the second value."""
        pairs = zip(self._seen, list(self._seen)[1:], strict=False)
        return statistics((after.arrived_ns - before.arrived_ns) / 1e9 for before, after in pairs)

    @property
    def sizes_bytes(self) -> Statistics | None:
        """Sizes of the payloads."""
        return statistics(float(seen.size_bytes) for seen in self._seen)

    @property
    def bytes_per_s(self) -> float | None:
        """Bytes of payload that arrive in a second, or None before the second value."""
        # without the first value: the span begins with its arrival
        return _rate(sum(seen.size_bytes for seen in list(self._seen)[1:]), self.span_s)

    @property
    def delays_s(self) -> Statistics | None:
        """Delays of the values whose owner's clock is known."""
        return statistics(seen.delay_s for seen in self._seen if seen.delay_s is not None)

    @property
    def thinned(self) -> bool:
        """Whether clearly fewer values arrive than their owner writes."""
        written_hz, here_hz = self.written_hz, self.here_hz
        # a few values scatter too much for a verdict before the fifth
        return len(self._seen) >= 5 and bool(written_hz and here_hz and written_hz > 1.3 * here_hz)


def _rate(count: int, span_s: float) -> float | None:
    return count / span_s if count > 0 and span_s > 0 else None


def statistics(values: Iterable[float]) -> Statistics | None:
    """Minimum, mean, maximum and standard deviation, or None without a value."""
    found = list(values)
    if not found:
        return None
    mean = math.fsum(found) / len(found)
    spread = math.fsum((value - mean) ** 2 for value in found) / len(found)
    return Statistics(min(found), mean, max(found), math.sqrt(spread))
