"""Rate and schedule of beacons: as often as subscribers need, within the capacity of the channel."""

from collections.abc import Callable
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import NEVER_NS

IDLE_HZ: Final = 2.0
"""Rate of a node without subscribers."""
CHANGING_HZ: Final = 5.0
"""Rate while links change: at 2 Hz a node at 10 m/s would detect the end of a link too late."""
MIN_HZ: Final = 0.2
QUIET_HELLOS: Final = 4
"""Consecutive hellos that declare a longer period before the rate falls: at a loss of 30 % a neighbour misses
all of them once in a hundred times."""
AIRTIME: Final = 0.24
"""Share of the channel for all beacons in range: less than a quarter, hellos included."""
TRIGGERED_NS: Final = 60_000_000
"""Maximum delay of a triggered beacon, random because many nodes react to the same event."""
JITTER: Final = 0.05
"""Jitter of beacons, as a share of the period."""
OVERLOAD_RATIO: Final = 0.2
"""The processor is overloaded when half of the last beacons were later than this share of the period."""
RECOVERY_RATIO: Final = 0.1
"""The processor has recovered when half of the last beacons were less late than this share of the faster
period."""
EVALUATION_NS: Final = 900_000_000
"""Period of evaluations: at 10 Hz before the link timeout of a second ends."""
EVALUATED_MIN: Final = 3
"""Minimum of beacons in an evaluation; at once when all of them are a whole period late."""
RECOVERY_NS: Final = 2 * EVALUATION_NS
"""Time without overload before the rate rises; it falls at once, so that it does not oscillate."""
STEP_MIN: Final = 1.25
STEP_MAX: Final = 4.0
SLOWDOWN_MAX: Final = 10.0
_FRAME_S: Final = 173e-6
_BYTE_S: Final = 1.333e-6
"""IEEE 802.11 OFDM at 6 Mb/s, the basic rate of multicast: DIFS 34 µs, back-off 67.5 µs in
the mean, preamble 20 µs, 39 bytes of headers, check sum and tail; then 8 bits / 6 Mb/s for each byte."""


def airtime_s(datagram_bytes: float) -> float:
    """Airtime of a multicast datagram with its IP header."""
    return _FRAME_S + _BYTE_S * datagram_bytes


def allowed_hz(neighbours: int, datagram_bytes: float) -> float:
    """Maximum beacon rate for a number of neighbours, after ETSI's decentralised congestion control."""
    return max(AIRTIME / ((neighbours + 1) * airtime_s(datagram_bytes)), MIN_HZ)


class ReportSlowdown(msgspec.Struct, frozen=True):
    """Action: report a change of the factor by which beacons are slowed, 1 if none is."""

    factor: float
    late_ns: int
    """Median lateness of the last beacons."""


class QuietRate:
    """The rate of a node without subscribers, which falls when its neighbours know the longer period.

    A neighbour that has lost that hello would take the link down after three lost beacons at the lower rate,
    and its change would raise the rate again.
    """

    def __init__(self) -> None:
        self._hellos = QUIET_HELLOS
        """Hellos that have declared the period of the lower rate; at first no shorter one was declared."""

    @property
    def is_falling(self) -> bool:
        """Whether the next beacon declares the longer period, at the present rate."""
        return self._hellos < QUIET_HELLOS

    def on_change(self) -> None:
        """Links change, or boards have subscribers."""
        self._hellos = 0

    def on_hello(self) -> None:
        """A hello has declared the longer period."""
        self._hellos += 1

    def hz(self) -> float:
        """The rate of the next beacons while no link changes."""
        return CHANGING_HZ if self.is_falling else IDLE_HZ


class Slowdown:
    """Reduces the beacon rate while the processor is overloaded.

    Neighbours take the link to a node down when its beacons are late. Before that happens the node lengthens
    its beacon period and declares the longer one in its hello. Fewer beacons save processor time here and at
    all nodes that receive them.
    """

    def __init__(self) -> None:
        self.factor = 1.0
        """Factor of the period, or 1 while the processor keeps up."""
        self.delayed_beacons = 0
        """Beacons that were delayed by the factor."""
        self.late_ns = 0
        """Median lateness at the last evaluation."""
        self._late_ns: list[int] = []
        self._recovered_ns = 0
        self._overloaded_at = 1.0
        """Factor at the last overload, or 1 once the processor has recovered at that factor."""

    def on_beacon(self, late_ns: int, period_ns: int) -> bool:
        """A beacon begins `late_ns` after it was due. True: the factor has changed.

        `period_ns`: between two beacons at present.
        """
        if self.factor > 1:
            self.delayed_beacons += 1
        self._late_ns.append(late_ns)
        newest = self._late_ns[-EVALUATED_MIN:]
        # late by whole periods in a row; the evaluation does not wait for its interval
        behind = min(newest) > period_ns
        if len(newest) < EVALUATED_MIN or (len(self._late_ns) * period_ns < EVALUATION_NS and not behind):
            return False
        judged = sorted(newest if behind else self._late_ns)
        self.late_ns = judged[len(judged) // 2]
        span_ns = len(self._late_ns) * period_ns
        self._late_ns.clear()
        before = self.factor
        # one step as large as the lateness, because neighbours take the link down within a second
        if self.late_ns > OVERLOAD_RATIO * period_ns:
            self._recovered_ns = 0
            self._overloaded_at = before
            step = min(max(self.late_ns / (OVERLOAD_RATIO * period_ns), STEP_MIN), STEP_MAX)
            self.factor = min(before * step, SLOWDOWN_MAX)
        # neither overloaded nor idle enough for the faster rate; the recovery counts from here again
        elif self.late_ns > RECOVERY_RATIO * period_ns / STEP_MIN:
            self._recovered_ns = 0
        else:
            self._recovered_ns += span_ns
            if self._recovered_ns >= RECOVERY_NS:
                self._recovered_ns = 0
                self._recover(period_ns)
        return self.factor != before

    def _recover(self, period_ns: int) -> None:
        """Raises the rate in one step, but in small steps near the rate of the last overload."""
        if self.factor <= self._overloaded_at:
            self._overloaded_at = 1.0
        step = min(RECOVERY_RATIO * period_ns / max(self.late_ns, 1), STEP_MAX)
        # a large step may not go beyond the factor of the last overload; the load may still be there
        small = self.factor / STEP_MIN
        self.factor = max(min(small, max(self.factor / step, self._overloaded_at * STEP_MIN)), 1.0)


class BeaconSchedule:
    """Schedule of the next beacon: due instant, jitter, triggered and skipped beacons."""

    def __init__(self, now_ns: int, chance: Callable[[], float]) -> None:
        """`chance`: uniform from 0 to 1; synchronised nodes would collide permanently."""
        self.due_ns = now_ns
        self.urgent = False
        """The next beacon is triggered by an event and must not be skipped."""
        self._resting = False
        """The next check coincides with the other periodic work; a beacon that it triggers gets random
        jitter."""
        self._skipped = False
        """A beacon was skipped since a beacon was sent last."""
        self._chance = chance
        self._left_ns = NEVER_NS

    def trigger(self, now_ns: int, gap_ns: int) -> bool:
        """Schedules a triggered beacon, `gap_ns` or more after the last one; returns whether it is sooner."""
        self.urgent = True
        soon_ns = max(now_ns + round(TRIGGERED_NS * (0.1 + 0.9 * self._chance())), self._left_ns + gap_ns)
        # the periodic beacon is sooner and carries the same news
        if soon_ns >= self.due_ns:
            return False
        self.due_ns = soon_ns
        return True

    def on_sent(self, now_ns: int) -> None:
        """Records a sent beacon."""
        self.urgent = self._resting = False
        self._left_ns = now_ns

    def skip(self, now_ns: int, period_ns: int) -> None:
        """Skips this beacon; the next check coincides with the other periodic work of the process."""
        self._resting = self._skipped = True
        self.due_ns = (now_ns // period_ns + 1) * period_ns

    def defer_after_skip(self, now_ns: int, period_ns: int) -> bool:
        """Delays the beacon after a skipped one by random jitter; returns whether it was delayed, and so must
        not be skipped.

        Nodes check at the same instants; without jitter they would send at the same instants.
        """
        if not self._resting:
            return False
        self._resting, self.urgent = False, True
        self.due_ns = now_ns + round(self.jitter_ns(period_ns) * self._chance())
        return True

    @staticmethod
    def jitter_ns(period_ns: int) -> int:
        """Width of the jitter, the difference of its limits."""
        return round(2 * JITTER * period_ns)

    def set_next(self, now_ns: int, period_ns: int) -> None:
        """Schedules the next beacon; the lateness of this one does not make the next ones early.

        After a beacon that followed skipped ones the next is probably skipped, too: it is due on the grid.
        """
        # rounded up to the grid on which the process wakes for its other periodic work
        if self._skipped:
            self._skipped, self._resting = False, True
            self.due_ns = -(-(now_ns + round(period_ns * (1 - JITTER))) // period_ns) * period_ns
            return
        spread = 1 + JITTER * (2 * self._chance() - 1)
        self.due_ns = max(self.due_ns, now_ns - period_ns) + round(period_ns * spread)
