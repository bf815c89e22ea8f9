"""Longest declared period between two beacons, which a restarted node needs to know."""

from typing import Final

import msgspec

_MS: Final = 1_000_000
CEILINGS_NS: Final = (125 * _MS, 250 * _MS, 500 * _MS, 1000 * _MS, 2000 * _MS, 4000 * _MS, 10_000 * _MS)
"""Classes of periods: a node whose rate varies within a class stores nothing."""
LOWER_NS: Final = 120_000_000_000
"""Time before a shorter period is stored: by then all neighbours have a newer hello, and writes are rare."""


def ceiling_ns(period_ns: int) -> int:
    """Class of a period: the next larger ceiling."""
    return next((ceiling for ceiling in CEILINGS_NS if period_ns <= ceiling), CEILINGS_NS[-1])


class DeclaredPeriod:
    """Longest period that a neighbour may still use for its deadline."""

    def __init__(self, kept_ns: int, now_ns: int) -> None:
        """`kept_ns`: declared period of the former session, or 0 without one."""
        self.ns = kept_ns
        self._since_ns = now_ns
        self._later_ns = 0
        """Longest period declared since then."""

    def declare(self, period_ns: int, now_ns: int) -> bool:
        """Declares the period of a hello; returns whether `ns` must be stored before the hello is sent."""
        ceiling = ceiling_ns(period_ns)
        if ceiling >= self.ns:
            rose = ceiling > self.ns
            self.ns, self._since_ns, self._later_ns = ceiling, now_ns, 0
            return rose
        self._later_ns = max(self._later_ns, ceiling)
        if now_ns - self._since_ns < LOWER_NS:
            return False
        self.ns, self._since_ns, self._later_ns = self._later_ns, now_ns, 0
        return True


class RestartState(msgspec.Struct, frozen=True):
    """State that a restarted broker keeps of the session before."""

    declared_period_ns: int = 0
    """Longest time between two datagrams that the former session declared, or 0 if unknown."""
    quiet_ns: int = 0
    """Time for which other nodes may still route through the former session."""
