"""Rate and schedule of beacons: as often as a subscriber needs, within the capacity of the channel."""

from collections.abc import Callable
from typing import Final

from swarmd.broker.core.beacon import NEVER_NS

IDLE_HZ: Final = 2.0
"""A node of which nobody wants anything periodic."""
CHANGING_HZ: Final = 5.0
"""The same while its links come and go: at 2 Hz a node at 10 m/s learns too late that a link has ended."""
MIN_HZ: Final = 0.2
AIRTIME: Final = 0.24
"""Share of the air that all beacons in hearing range may take: less than a quarter, hellos included."""
TRIGGERED_NS: Final = 60_000_000
"""What cannot wait leaves within this time, spread by chance: many hear of it at once."""
JITTER: Final = 0.05
"""Beacons are spread by this share of their period."""
OVERLOAD_RATIO: Final = 0.2
"""The processor is short when half of the last beacons began later than this share of their period."""
RECOVERY_RATIO: Final = 0.1
"""It is not when at the faster rate they would have begun less late than this share."""
EVALUATION_NS: Final = 900_000_000
"""Time after which the lateness of beacons is judged: at 10 Hz before the link timeout of a second ends."""
EVALUATED_MIN: Final = 3
"""Beacons that are judged together at least; at once when all of them begin a whole period late."""
RECOVERY_NS: Final = 2 * EVALUATION_NS
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
    return max(AIRTIME / ((heard + 1) * airtime_s(datagram_bytes)), MIN_HZ)


def beacon_hz(wanted_hz: float, heard: int, datagram_bytes: float) -> float:
    """Beacon rate among so many others in hearing range."""
    return min(wanted_hz, allowed_hz(heard, datagram_bytes))


class Slowdown:
    """Factor by which beacons are sent less often than wanted while its processor does not keep up.

    A node whose beacons begin late is taken for gone by its neighbours. It says less often that it is there,
    and says so (the hello declares its period), before links fall; what it saves is processor time here and
    at all that hear it.
    """

    def __init__(self) -> None:
        self.factor = 1.0
        """Times the wanted period; 1: the processor keeps up."""
        self.delayed_beacons = 0
        """Beacons that were due later because of it."""
        self.late_ns = 0
        """Half of the beacons judged last began later than this."""
        self._late_ns: list[int] = []
        self._recovered_ns = 0
        self._overloaded_at = 1.0
        """Factor at which the processor was short last; 1: it has been calm at that one since."""

    def on_beacon(self, late_ns: int, period_ns: int) -> bool:
        """A beacon begins `late_ns` after it was due. True: the factor has changed.

        `period_ns`: between two beacons at present.
        """
        if self.factor > 1:
            self.delayed_beacons += 1
        self._late_ns.append(late_ns)
        newest = self._late_ns[-EVALUATED_MIN:]
        behind = min(newest) > period_ns
        if len(newest) < EVALUATED_MIN or (len(self._late_ns) * period_ns < EVALUATION_NS and not behind):
            return False
        judged = sorted(newest if behind else self._late_ns)
        self.late_ns = judged[len(judged) // 2]
        span_ns = len(self._late_ns) * period_ns
        self._late_ns.clear()
        before = self.factor
        if self.late_ns > OVERLOAD_RATIO * period_ns:
            self._recovered_ns = 0
            self._overloaded_at = before
            step = min(max(self.late_ns / (OVERLOAD_RATIO * period_ns), STEP_MIN), STEP_MAX)
            self.factor = min(before * step, SLOWDOWN_MAX)
        elif self.late_ns > RECOVERY_RATIO * period_ns / STEP_MIN:
            self._recovered_ns = 0
        else:
            self._recovered_ns += span_ns
            if self._recovered_ns >= RECOVERY_NS:
                self._recovered_ns = 0
                self._recover(period_ns)
        return self.factor != before

    def _recover(self, period_ns: int) -> None:
        """In one step to the rate that promises to be calm, but near the one that was not in small steps."""
        if self.factor <= self._overloaded_at:
            self._overloaded_at = 1.0
        step = min(RECOVERY_RATIO * period_ns / max(self.late_ns, 1), STEP_MAX)
        small = self.factor / STEP_MIN
        self.factor = max(min(small, max(self.factor / step, self._overloaded_at * STEP_MIN)), 1.0)


class BeaconSchedule:
    """When the next datagram leaves."""

    def __init__(self, now_ns: int, chance: Callable[[], float]) -> None:
        """`chance`: evenly from 0 to 1; nodes in step would collide for ever."""
        self.due_ns = now_ns
        self.urgent = False
        """The next beacon has something to say that cannot wait."""
        self._resting = False
        self._chance = chance
        self._left_ns = NEVER_NS

    def trigger(self, now_ns: int, gap_ns: int) -> bool:
        """The next beacon shall leave soon, but `gap_ns` after the last one. True: it is due earlier now."""
        self.urgent = True
        soon_ns = max(now_ns + round(TRIGGERED_NS * (0.1 + 0.9 * self._chance())), self._left_ns + gap_ns)
        if soon_ns >= self.due_ns:
            return False
        self.due_ns = soon_ns
        return True

    def on_sent(self, now_ns: int) -> None:
        """A datagram left."""
        self.urgent = self._resting = False
        self._left_ns = now_ns

    def skip(self, now_ns: int, period_ns: int) -> None:
        """This beacon says nothing; the next look is where the process does its other periodic work."""
        self._resting = True
        self.due_ns = (now_ns // period_ns + 1) * period_ns

    def defer_after_skip(self, now_ns: int, period_ns: int) -> bool:
        """True: a beacon that follows one without words waits for its share of chance; it is due then.

        Nodes that look at the same instants would send at the same ones.
        """
        if not self._resting:
            return False
        self._resting, self.urgent = False, True
        self.due_ns = now_ns + round(self.jitter_ns(period_ns) * self._chance())
        return True

    @staticmethod
    def jitter_ns(period_ns: int) -> int:
        """From the earliest to the latest instant of a beacon."""
        return round(2 * JITTER * period_ns)

    def set_next(self, now_ns: int, period_ns: int) -> None:
        """This beacon is over; one that was late does not make the next ones early."""
        spread = 1 + JITTER * (2 * self._chance() - 1)
        self.due_ns = max(self.due_ns, now_ns - period_ns) + round(period_ns * spread)
