"""How slow a node may be taken to be: what it must know after a restart of the session before."""

from typing import Final

_MS: Final = 1_000_000
CEILINGS_NS: Final = (125 * _MS, 250 * _MS, 500 * _MS, 1000 * _MS, 2000 * _MS, 4000 * _MS, 10_000 * _MS)
"""A period is kept as the next of these: a node whose rate wavers writes nothing."""
LOWER_NS: Final = 120_000_000_000
"""All have long had a newer hello then; and the file is written twice a minute at the most."""


def ceiling_ns(period_ns: int) -> int:
    """The class to which a period belongs."""
    return next((ceiling for ceiling in CEILINGS_NS if period_ns <= ceiling), CEILINGS_NS[-1])


class DeclaredPeriod:
    """The longest time between two of our datagrams that a neighbour may still count on."""

    def __init__(self, kept_ns: int, now_ns: int) -> None:
        """`kept_ns`: of the former session; 0: there was none."""
        self.ns = kept_ns
        self._since_ns = now_ns
        self._later_ns = 0
        """The slowest declared since then."""

    def declare(self, period_ns: int, now_ns: int) -> bool:
        """A hello is to declare a period. True: `ns` changed, and has to be kept before the hello leaves."""
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
