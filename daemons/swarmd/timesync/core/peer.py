"""Estimator of one remote clock: exchanges in, conversion function out; detects steps of either clock."""

from typing import Final

import msgspec

from swarmd.timesync.core.corridor import SKEW_LIMIT, Corridor, Estimate, NoLine
from swarmware.model.names import Address
from swarmware.types.time import Conversion

RESOLUTION_NS: Final = 1_000
"""Resolution of transmitted stamps (share/doc/protocol.md 3.1): a difference of two is less than 1 µs off."""

STEP_MARGIN_NS: Final = 200_000
"""Margin of step detection: a deviation beyond this and the bound of the prediction is a clock step."""

SILENCE_NS: Final = 5_000_000_000
"""Silence after which only the hard bound proves a step: the statistical error assumes a constant skew, which
temperature changes meanwhile."""

STEP_COUNT: Final = 3
"""Violations in a row that prove a step; fewer are outliers. 0.3 s at 10 Hz."""

FIRST_SOLVES_S: Final = 0.1
"""First pause between two estimations; each estimation doubles it."""

TOGETHER_NS: Final = 500_000_000
"""Estimations that are not urgent are done at multiples of this, together with the other periodic work of the
process."""
TOGETHER_RATIO: Final = 2
"""Applied only to pauses of at least this many periods of `TOGETHER_NS`."""
SLACK_NS: Final = 100_000_000
"""Maximum delay of the end of a long pause: the span of a window of 60 s is a little shorter than 60 s."""
SURPRISE_PAUSE_S: Final = 1.0
"""Pause between two estimations after an exchange that deviates from the prediction."""

SPAN_RATIO: Final = 20
"""Minimum ratio of the span of the exchanges to the pause: the longer the span, the less a second adds."""


def due_together_ns(since_ns: int, pause_ns: int) -> int:
    """The end of a pause; of a long one the next instant at which others end, too."""
    due_ns = since_ns + pause_ns
    return due_ns if pause_ns < TOGETHER_RATIO * TOGETHER_NS else -(-due_ns // TOGETHER_NS) * TOGETHER_NS


def estimation_due_ns(since_ns: int, pause_ns: int) -> int:
    """The end of a pause between estimations; long ones that are equal end together, at a multiple of them.

    Estimations in one wake-up share the caches of the processor, and one publication.
    """
    due_ns = since_ns + pause_ns
    if pause_ns < TOGETHER_RATIO * TOGETHER_NS:
        return due_ns
    period_ns = (pause_ns + SLACK_NS) // TOGETHER_NS * TOGETHER_NS
    return (due_ns + SLACK_NS) // period_ns * period_ns


class Exchange(msgspec.Struct, frozen=True, gc=False):
    """The bounds on the offset of a remote clock from one received packet."""

    received_ns: int
    """Local clock at the arrival of the packet."""
    lower_ns: int
    """Remote send time minus local receive time: a lower bound of the offset."""
    sent_ns: int = 0
    """Local clock when the echoed packet was sent."""
    upper_ns: int | None = None
    """Remote receive time minus local send time of that packet: an upper bound; None without an echo."""


class ClockEstimator:
    """Estimates the clock of one hardware unit, for one of its boots."""

    def __init__(
        self,
        platform: str,
        unit: str,
        hardware: int,
        boot_id: int,
        *,
        window_s: float,
        pause_s: float,
        conv_epoch: int,
    ) -> None:
        self.platform = platform
        self.unit = unit
        self.hardware = hardware
        self.boot_id = boot_id
        self.conversion: Conversion | None = None
        self.steps = 0
        self.name = str(Address(platform, unit))
        self._window_s = window_s
        self._pause_s = pause_s
        self.conv_epoch = conv_epoch
        self._next_pause_s = FIRST_SOLVES_S
        self._solved_ns: int | None = None
        self._dirty = False
        self._unverified: Conversion | None = None
        self._violations: list[Exchange] = []
        self._estimate: Estimate | None = None
        self._surprised = False
        self._surprise_ns: int | None = None
        """The newest exchange that deviated from the prediction, or the first one."""
        self._samples = 0
        self._origin_ns = 0
        self._base_ns = 0
        self._rtt_ns = 0
        """Smallest round trip of the present window; 0: none yet."""
        self._rtt_before_ns = 0
        """The same of the window before."""
        self._rtt_until_ns = 0
        self._newest_ns: int | None = None
        self._corridor = Corridor(window_s)

    @property
    def received_ns(self) -> int | None:
        """Local clock at the newest exchange; None before the first."""
        return self._newest_ns

    def on_exchange(self, exchange: Exchange) -> bool:
        """Takes one exchange; True when it completes the proof of a clock step."""
        upper_ns = exchange.upper_ns
        # the two bounds are of different instants: an echo may be delayed for seconds
        drift_ns = round(SKEW_LIMIT * (exchange.received_ns - exchange.sent_ns))
        if upper_ns is not None and upper_ns + drift_ns + RESOLUTION_NS < exchange.lower_ns - RESOLUTION_NS:
            # the remote clock stepped between packet and echo: the echo is of the clock before the step
            exchange = msgspec.structs.replace(exchange, upper_ns=None)
        direction = self._violates(exchange)
        if direction == 0:
            self._violations.clear()
            self._take(exchange)
            return False
        self._violations.append(exchange)
        if len(self._violations) < STEP_COUNT:
            return False
        proofs, self._violations = self._violations, []
        self._restart()
        for proof in proofs:
            # the remote clock stepped forward: the echo of an earlier packet may be of the clock before it
            old = direction > 0 and proof.sent_ns < proofs[0].received_ns
            self._take(msgspec.structs.replace(proof, upper_ns=None) if old else proof)
        return True

    def _violates(self, exchange: Exchange) -> int:
        """+1: the remote clock is impossibly far ahead of the prediction; −1: behind; 0: consistent."""
        known = self.conversion
        if known is None or not known.samples:
            return 0
        now_ns = exchange.received_ns
        silent = self._newest_ns is None or now_ns - self._newest_ns >= SILENCE_NS
        estimate = self._estimate
        settled = estimate is not None and estimate.settled
        known_ns = known.likely_at_ns(now_ns) if settled and not silent else known.bound_at_ns(now_ns)
        margin_ns = STEP_MARGIN_NS + known_ns
        ahead_ns = exchange.lower_ns - (known.to_remote(now_ns) - now_ns)
        if ahead_ns > margin_ns:
            return 1
        upper_ns, sent_ns = exchange.upper_ns, exchange.sent_ns
        behind_ns = ahead_ns if upper_ns is None else known.to_remote(sent_ns) - sent_ns - upper_ns
        if behind_ns > margin_ns and upper_ns is not None:
            return -1
        if estimate is not None and settled:
            expected_ns = RESOLUTION_NS + (estimate.surprise_s - estimate.half_s) * 1e9
            if max(ahead_ns, behind_ns) > expected_ns:
                self._surprised = True
                self._surprise_ns = now_ns
        return 0

    def _take(self, exchange: Exchange) -> None:
        if not self._samples:
            self._origin_ns = exchange.received_ns
            self._base_ns = exchange.lower_ns
            self._surprise_ns = exchange.received_ns
        self._samples += 1
        self._newest_ns = exchange.received_ns
        self._dirty = True
        base_ns = self._base_ns
        self._corridor.add_lower(
            (exchange.received_ns - self._origin_ns) / 1e9,
            (exchange.lower_ns - base_ns - RESOLUTION_NS) / 1e9,
        )
        if exchange.upper_ns is None:
            return
        self._take_round_trip(exchange.upper_ns - exchange.lower_ns, exchange)
        if exchange.received_ns - exchange.sent_ns <= self._window_s * 1e9:
            upper_ns = exchange.upper_ns + RESOLUTION_NS - self._base_ns
            self._corridor.add_upper((exchange.sent_ns - self._origin_ns) / 1e9, upper_ns / 1e9)

    def _take_round_trip(self, difference_ns: int, exchange: Exchange) -> None:
        """Takes the difference of the two bounds, which are of different instants.

        The echo was held meanwhile, for up to a second, on a clock of another rate: 40 ppm of half a second
        are 20 µs, more than a round trip within a computer. The limit of the error counts as part of
        the round trip: otherwise the minimum would be the sample with the largest error.
        """
        known, apart_ns = self.conversion, exchange.received_ns - exchange.sent_ns
        if known is None or not known.samples:
            return
        rtt_ns = max(round(difference_ns + (known.skew + known.skew_bound) * apart_ns), RESOLUTION_NS)
        if exchange.received_ns >= self._rtt_until_ns:
            self._rtt_until_ns = exchange.received_ns + round(self._window_s * 1e9)
            self._rtt_before_ns, self._rtt_ns = self._rtt_ns, 0
        self._rtt_ns = min(self._rtt_ns, rtt_ns) if self._rtt_ns else rtt_ns

    @property
    def _smallest_rtt_ns(self) -> int:
        found = [rtt_ns for rtt_ns in (self._rtt_before_ns, self._rtt_ns) if rtt_ns]
        return min(found, default=0)

    def _restart(self) -> None:
        """Discards the function after a step of either clock."""
        self._clear()
        self._unverified = None
        self.conversion = None
        self._step()

    def _step(self) -> None:
        self.steps += 1
        self.conv_epoch += 1

    def _clear(self) -> None:
        """Discards all but the skew: an oscillator keeps its rate when its clock is set."""
        self._corridor = Corridor(self._window_s, self._corridor.skew)
        self._estimate = None
        self._surprised = False
        self._samples = 0
        self._rtt_ns = self._rtt_before_ns = self._rtt_until_ns = 0
        self._next_pause_s = FIRST_SOLVES_S
        self._solved_ns = None
        self._dirty = False

    def due_ns(self) -> int | None:
        """Instant of the next estimation; None without new exchanges."""
        if not self._dirty:
            return None
        if self._solved_ns is None:
            return self._newest_ns
        pause_s = min(SURPRISE_PAUSE_S, self._next_pause_s) if self._surprised else self._next_pause_s
        return estimation_due_ns(self._solved_ns, round(pause_s * 1e9))

    def solve(self, now_ns: int) -> bool:
        """Estimates the function; True when this detected a small clock step."""
        self._dirty = False
        breaks = self._corridor.breaks
        try:
            surprise_ns = now_ns if self._surprise_ns is None else self._surprise_ns
            search = now_ns - surprise_ns <= self._window_s * 1e9
            estimate = self._corridor.solve((now_ns - self._origin_ns) / 1e9, search=search)
        except NoLine:
            # a small step, or one invalid stamp: the function stays until new packets decide
            self._unverified = self.conversion
            self._clear()
            return False
        if self._corridor.breaks > breaks:
            self._unverified = self.conversion
        if estimate is None:
            self._solved_ns = None  # estimated again with the next packet
            return False
        if self._surprised:
            self._next_pause_s = SURPRISE_PAUSE_S
        elif self._solved_ns is not None:
            self._next_pause_s *= 2
        longest_s = max(SURPRISE_PAUSE_S, estimate.span_s / SPAN_RATIO)
        self._next_pause_s = min(self._next_pause_s, longest_s, self._pause_s)
        self._surprised = False
        self._solved_ns = now_ns
        self._estimate = estimate
        found = self._function(estimate, now_ns)
        stepped = self._unverified is not None and not found.agrees(self._unverified, now_ns)
        self._unverified = None
        if stepped:
            self._step()
            found = msgspec.structs.replace(found, conv_epoch=self.conv_epoch)
        self.conversion = found
        return stepped

    def _function(self, estimate: Estimate, now_ns: int) -> Conversion:
        return Conversion(
            platform=self.platform,
            unit=self.unit,
            hardware=self.hardware,
            boot_id=self.boot_id,
            offset_ns=self._base_ns + round(estimate.theta_s * 1e9),
            skew=estimate.skew,
            t0_ns=now_ns,
            bound_ns=round(estimate.bound_s * 1e9),
            sigma_ns=round(estimate.sigma_s * 1e9),
            skew_bound=estimate.skew_bound,
            conv_epoch=self.conv_epoch,
            samples=self._samples,
            rtt_ns=self._smallest_rtt_ns,
        )
