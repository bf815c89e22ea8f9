"""How often a node ticks, and when: as often as somebody needs it, never more than the air carries."""

from collections.abc import Callable
from typing import Final

from swarmd.broker.core.tick import NEVER_NS

IDLE_HZ: Final = 2.0
"""A node of which nobody wants anything periodic."""
QUICK_HZ: Final = 5.0
"""The same while its links come and go: at 2 Hz a node at 10 m/s learns too late that a link has ended."""
LEAST_HZ: Final = 0.2
AIRTIME: Final = 0.24
"""Share of the air that all ticks in hearing range may take: less than a quarter, hellos included."""
HURRY_NS: Final = 60_000_000
"""What cannot wait leaves within this time, spread by chance: many hear of it at once."""
JITTER: Final = 0.05
"""Ticks are spread by this share of their period."""
_FRAME_S: Final = 173e-6
_BYTE_S: Final = 1.333e-6
"""OFDM at the 6 Mb/s basic rate of multicast, DIFS, backoff and preamble; fits 180 B in 413 µs and
600 B in 973 µs of the scale study, section 1.3."""


def airtime_s(datagram_bytes: float) -> float:
    """Time that one multicast datagram takes on the air, IP header included."""
    return _FRAME_S + _BYTE_S * datagram_bytes


def allowed_hz(heard: int, datagram_bytes: float) -> float:
    """Most datagrams per second among so many others, after ETSI's decentralised congestion control."""
    return max(AIRTIME / ((heard + 1) * airtime_s(datagram_bytes)), LEAST_HZ)


def tick_hz(wanted_hz: float, heard: int, datagram_bytes: float) -> float:
    """Tick rate among so many others in hearing range."""
    return min(wanted_hz, allowed_hz(heard, datagram_bytes))


class Pace:
    """When the next datagram leaves."""

    def __init__(self, now_ns: int, chance: Callable[[], float]) -> None:
        """`chance`: evenly from 0 to 1; nodes in step would collide for ever."""
        self.due_ns = now_ns
        self.urgent = False
        """The next tick has something to say that cannot wait."""
        self._chance = chance
        self._left_ns = NEVER_NS

    def hurry(self, now_ns: int, gap_ns: int) -> bool:
        """The next tick shall leave soon, but `gap_ns` after the last one. True: it is due earlier now."""
        self.urgent = True
        soon_ns = max(now_ns + round(HURRY_NS * (0.1 + 0.9 * self._chance())), self._left_ns + gap_ns)
        if soon_ns >= self.due_ns:
            return False
        self.due_ns = soon_ns
        return True

    def left(self, now_ns: int) -> None:
        """A datagram left."""
        self.urgent = False
        self._left_ns = now_ns

    def next(self, now_ns: int, period_ns: int) -> None:
        """This tick is over; one that was late does not make the next ones early."""
        spread = 1 + JITTER * (2 * self._chance() - 1)
        self.due_ns = max(self.due_ns, now_ns - period_ns) + round(period_ns * spread)
