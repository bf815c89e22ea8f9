"""Estimator of one remote clock: turns exchanges into a conversion function, and detects clock steps."""

from typing import Final

import msgspec

from swarmd.timesync.core.corridor import SKEW_LIMIT, Corridor, Estimate, NoLine
from swarmware.model.names import Address
from swarmware.types.time import Conversion

RESOLUTION_NS: Final = 1_000
"""Resolution of transmitted stamps (share/doc/protocol.md 3.1); a difference of two errs by less than 1
µs."""

STEP_MARGIN_NS: Final = 200_000
"""Margin of step detection; a deviation beyond the bound of the prediction plus this margin is a step."""

SILENCE_NS: Final = 5_000_000_000
"""Silence after which only the hard bound proves a step. The statistical error assumes a constant skew, but
temperature changes the skew during a silence."""

STEP_COUNT: Final = 3
"""Consecutive violations that prove a step, 0.3 s at 10 Hz; fewer violations are outliers."""

FIRST_SOLVES_S: Final = 0.1
"""First pause between two estimations; each estimation doubles it."""

TOGETHER_NS: Final = 500_000_000
"""Grid of the estimations that are not urgent, so that they share a wake-up with other periodic work."""
TOGETHER_RATIO: Final = 2
"""Minimum length of a pause that ends on the grid, in periods of `TOGETHER_NS`."""
SLACK_NS: Final = 100_000_000
"""Maximum extension of a long pause, which is a little short: a window of 60 s spans a little less than 60
s."""
SURPRISE_PAUSE_S: Final = 1.0
"""Pause between two estimations after an exchange that deviates from the prediction."""

SPAN_RATIO: Final = 20
"""Ratio of the span of the exchanges to the longest pause; a second adds less to a longer span."""


def due_together_ns(since_ns: int, pause_ns: int) -> int:
    """End of a pause; a long pause ends on the next point of the grid `TOGETHER_NS`."""
    due_ns = since_ns + pause_ns
    return due_ns if pause_ns < TOGETHER_RATIO * TOGETHER_NS else -(-due_ns // TOGETHER_NS) * TOGETHER_NS


def estimation_due_ns(since_ns: int, pause_ns: int) -> int:
    """End of a pause between estimations; long pauses of equal length end together, at a multiple of it.

    Estimations in one wake-up share the caches of the processor, and one publication.
    """
    due_ns = since_ns + pause_ns
    if pause_ns < TOGETHER_RATIO * TOGETHER_NS:
        return due_ns
    period_ns = (pause_ns + SLACK_NS) // TOGETHER_NS * TOGETHER_NS
    return (due_ns + SLACK_NS) // period_ns * period_ns


class Exchange(msgspec.Struct, frozen=True, gc=False):
    """Bounds on the offset of a remote clock, from one received packet and its echo."""

    received_ns: int
    """Local clock at the arrival of the packet."""
    lower_ns: int
    """Remote send time minus local receive time: a lower bound of the offset."""
    sent_ns: int = 0
    """Local clock when the echoed packet was sent."""
    upper_ns: int | None = None
    """Upper bound of the offset, remote receive time minus `sent_ns`, or None without an echo."""


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
        """Instant of the newest exchange that deviated from the prediction, or of the first exchange."""
        self._samples = 0
        self._origin_ns = 0
        self._base_ns = 0
        self._rtt_ns = 0
        """Minimum round trip of the present window, or 0 before the first round trip."""
        self._rtt_before_ns = 0
        """Minimum round trip of the previous window, or 0 if it had none."""
        self._rtt_until_ns = 0
        self._newest_ns: int | None = None
        self._corridor = Corridor(window_s)

    @property
    def received_ns(self) -> int | None:
        """Local clock at the newest exchange, or None before the first exchange."""
        return self._newest_ns

    def on_exchange(self, exchange: Exchange) -> bool:
        """Takes one exchange; returns True if it completes the proof of a clock step."""
        upper_ns = exchange.upper_ns
        # the two bounds hold at different instants, seconds apart if the echo was delayed
        drift_ns = round(SKEW_LIMIT * (exchange.received_ns - exchange.sent_ns))
        if upper_ns is not None and upper_ns + drift_ns + RESOLUTION_NS < exchange.lower_ns - RESOLUTION_NS:
            # the remote clock stepped between packet and echo, so the echo shows the clock before the step
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
            # after a step forward, the echo of an earlier packet may show the clock before the step
            old = direction > 0 and proof.sent_ns < proofs[0].received_ns
            self._take(msgspec.structs.replace(proof, upper_ns=None) if old else proof)
        return True

    def _violates(self, exchange: Exchange) -> int:
        """Direction of a violation: +1 if the remote clock is ahead of the prediction, −1 if behind, 0 if
        neither."""
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
        # judged at the send time, at which the upper bound holds
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
        # a longer delayed echo is older than the window
        if exchange.received_ns - exchange.sent_ns <= self._window_s * 1e9:
            upper_ns = exchange.upper_ns + RESOLUTION_NS - self._base_ns
            self._corridor.add_upper((exchange.sent_ns - self._origin_ns) / 1e9, upper_ns / 1e9)

    def _take_round_trip(self, difference_ns: int, exchange: Exchange) -> None:
        """Takes the difference of the two bounds, which hold at different instants.

        The peer held the echo for up to a second, on a clock of another rate: 40 ppm of half a second are
        20 µs, more than a round trip within a computer. The limit of this error is added to the round trip;
        otherwise the sample with the largest error would be the minimum.
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
        """Discards the function and all exchanges after a step of either clock."""
        self._clear()
        self._unverified = None
        self.conversion = None
        self._step()

    def _step(self) -> None:
        self.steps += 1
        self.conv_epoch += 1

    def _clear(self) -> None:
        """Discards everything except the skew, because an oscillator keeps its rate when its clock is set."""
        self._corridor = Corridor(self._window_s, self._corridor.skew)
        self._estimate = None
        self._surprised = False
        self._samples = 0
        self._rtt_ns = self._rtt_before_ns = self._rtt_until_ns = 0
        self._next_pause_s = FIRST_SOLVES_S
        self._solved_ns = None
        self._dirty = False

    def due_ns(self) -> int | None:
        """Instant of the next estimation, or None without new exchanges."""
        if not self._dirty:
            return None
        if self._solved_ns is None:
            return self._newest_ns
        pause_s = min(SURPRISE_PAUSE_S, self._next_pause_s) if self._surprised else self._next_pause_s
        return estimation_due_ns(self._solved_ns, round(pause_s * 1e9))

    def solve(self, now_ns: int) -> bool:
        """Estimates the function; returns True if the estimation detected a small clock step."""
        self._dirty = False
        breaks = self._corridor.breaks
        try:
            # the search is the costly part, and useless after a window without a deviation
            surprise_ns = now_ns if self._surprise_ns is None else self._surprise_ns
            search = now_ns - surprise_ns <= self._window_s * 1e9
            estimate = self._corridor.solve((now_ns - self._origin_ns) / 1e9, search=search)
        except NoLine:
            # a small step or one invalid stamp: the old function stays until new packets decide
            self._unverified = self.conversion
            self._clear()
            return False
        if self._corridor.breaks > breaks:
            self._unverified = self.conversion
        if estimate is None:
            self._solved_ns = None  # estimate again with the next packet
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
