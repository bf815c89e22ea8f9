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
SHORT: Final = 0.2
"""The processor is short when half of the last ticks began later than this share of their period."""
CALM: Final = 0.1
"""It is not when at the faster rate they would have begun less late than this share."""
JUDGED_NS: Final = 900_000_000
"""Time after which the lateness of ticks is judged: at 10 Hz before the link timeout of a second ends."""
JUDGED: Final = 3
"""Ticks that are judged together at least; at once when all of them begin a whole period late."""
CALM_NS: Final = 2 * JUDGED_NS
"""A node becomes faster when it was calm for this long, and slower at once: it must not swing."""
STEP_MIN: Final = 1.25
STEP_MAX: Final = 4.0
SLOWDOWN_MAX: Final = 10.0
_FRAME_S: Final = 173e-6
_BYTE_S: Final = 1.333e-6
"""IEEE 802.11 OFDM at 6 Mb/s, the basic rate of multicast: DIFS 34 µs, back-off 67.5 µs in
the mean, preamble 20 µs, 39 bytes of headers, check sum and tail; then 8 bits / 6 Mb/s for each byte."""


def airtime_s(datagram_bytes: float) -> float:
    """Time that one multicast datagram takes on the air, IP header included."""
    return _FRAME_S + _BYTE_S * datagram_bytes


def allowed_hz(heard: int, datagram_bytes: float) -> float:
    """Most datagrams per second among so many others, after ETSI's decentralised congestion control."""
    return max(AIRTIME / ((heard + 1) * airtime_s(datagram_bytes)), LEAST_HZ)


def tick_hz(wanted_hz: float, heard: int, datagram_bytes: float) -> float:
    """Tick rate among so many others in hearing range."""
    return min(wanted_hz, allowed_hz(heard, datagram_bytes))


class Slowdown:
    """How much slower than wanted a node ticks, because its processor does not keep up.

    A node whose ticks begin late is taken for gone by its neighbours. It says less often that it is there,
    and says so (the hello declares its period), before links fall; what it saves is processor time here and
    at all that hear it.
    """

    def __init__(self) -> None:
        self.factor = 1.0
        """Times the wanted period; 1: the processor keeps up."""
        self.ticks = 0
        """Ticks that were due later because of it."""
        self.late_ns = 0
        """Half of the ticks judged last began later than this."""
        self._late_ns: list[int] = []
        self._calm_ns = 0
        self._short_at = 1.0
        """Factor at which the processor was short last; 1: it has been calm at that one since."""

    def on_tick(self, late_ns: int, period_ns: int) -> bool:
        """A tick begins `late_ns` after it was due. True: the factor has changed.

        `period_ns`: between two ticks at present.
        """
        if self.factor > 1:
            self.ticks += 1
        self._late_ns.append(late_ns)
        newest = self._late_ns[-JUDGED:]
        behind = min(newest) > period_ns
        if len(newest) < JUDGED or (len(self._late_ns) * period_ns < JUDGED_NS and not behind):
            return False
        judged = sorted(newest if behind else self._late_ns)
        self.late_ns = judged[len(judged) // 2]
        span_ns = len(self._late_ns) * period_ns
        self._late_ns.clear()
        before = self.factor
        if self.late_ns > SHORT * period_ns:
            self._calm_ns = 0
            self._short_at = before
            step = min(max(self.late_ns / (SHORT * period_ns), STEP_MIN), STEP_MAX)
            self.factor = min(before * step, SLOWDOWN_MAX)
        elif self.late_ns > CALM * period_ns / STEP_MIN:
            self._calm_ns = 0
        else:
            self._calm_ns += span_ns
            if self._calm_ns >= CALM_NS:
                self._calm_ns = 0
                self._recover(period_ns)
        return self.factor != before

    def _recover(self, period_ns: int) -> None:
        """In one step to the rate that promises to be calm, but near the one that was not in small steps."""
        if self.factor <= self._short_at:
            self._short_at = 1.0
        step = min(CALM * period_ns / max(self.late_ns, 1), STEP_MAX)
        small = self.factor / STEP_MIN
        self.factor = max(min(small, max(self.factor / step, self._short_at * STEP_MIN)), 1.0)


class Pace:
    """When the next datagram leaves."""

    def __init__(self, now_ns: int, chance: Callable[[], float]) -> None:
        """`chance`: evenly from 0 to 1; nodes in step would collide for ever."""
        self.due_ns = now_ns
        self.urgent = False
        """The next tick has something to say that cannot wait."""
        self._resting = False
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
        self.urgent = self._resting = False
        self._left_ns = now_ns

    def rest(self, now_ns: int, period_ns: int) -> None:
        """This tick says nothing; the next look is where the process does its other periodic work."""
        self._resting = True
        self.due_ns = (now_ns // period_ns + 1) * period_ns

    def rises(self, now_ns: int, period_ns: int) -> bool:
        """True: a tick that follows one without words waits for its share of chance; it is due then.

        Nodes that look at the same instants would send at the same ones.
        """
        if not self._resting:
            return False
        self._resting, self.urgent = False, True
        self.due_ns = now_ns + round(self.spread_ns(period_ns) * self._chance())
        return True

    @staticmethod
    def spread_ns(period_ns: int) -> int:
        """From the earliest to the latest instant of a tick."""
        return round(2 * JITTER * period_ns)

    def next(self, now_ns: int, period_ns: int) -> None:
        """This tick is over; one that was late does not make the next ones early."""
        spread = 1 + JITTER * (2 * self._chance() - 1)
        self.due_ns = max(self.due_ns, now_ns - period_ns) + round(period_ns * spread)
