"""One remote clock: its exchanges in, its conversion function out, steps of either clock noticed."""

from typing import Final

import msgspec

from swarmd.timesync.corridor import SKEW_LIMIT, Corridor, Estimate, NoLine
from swarmware.types.time import Conversion

RESOLUTION_NS: Final = 1_000
"""Stamps travel as whole µs (share/doc/protocol.md 3.1): a difference of two is off by less than one."""

STEP_MARGIN_NS: Final = 200_000
"""A prediction outside the bounds by more than this and its own error is a clock step."""

SILENCE_NS: Final = 5_000_000_000
"""After a silence this long only the hard bound proves a step: the statistical error takes the rate for
constant, and temperature changes it while nobody measures."""

STEP_COUNT: Final = 3
"""Violations in a row that are a step and not an outlier: 0.3 s at 10 Hz."""

FIRST_SOLVES_S: Final = 0.1
"""A new function is worth being improved soon; each solve doubles the pause."""

TOGETHER_NS: Final = 100_000_000
"""Functions that are not urgent are solved at multiples of this: those of several peers in one wake, together
with the other periodic work of the process."""
TOGETHER_RATIO: Final = 10
"""Only where it delays a solution by no more than this part of the pause before it."""
EAGER_S: Final = 1.0
"""Pause after an exchange that the function did not foresee."""

SPAN_RATIO: Final = 20
"""A pause is at most this part of the span behind a function: the longer that is, the less a second adds."""


class Exchange(msgspec.Struct, frozen=True, gc=False):
    """What one received packet says about the sender's clock."""

    received_ns: int
    """Our clock at its arrival."""
    least_ns: int
    """Their send time minus our receive time: they are at least so far ahead."""
    sent_ns: int = 0
    """Our clock when the packet that they echo left."""
    most_ns: int | None = None
    """Their receive time minus our send time of that packet: at most so far ahead; None without echo."""


class Peer:
    """The estimator of one hardware unit's clock, for one boot of it."""

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
        self.outliers = 0
        self._window_s = window_s
        self._pause_s = pause_s
        self.conv_epoch = conv_epoch
        self._next_pause_s = FIRST_SOLVES_S
        self._solved_ns: int | None = None
        self._dirty = False
        self._doubted: Conversion | None = None
        self._violations: list[Exchange] = []
        self._estimate: Estimate | None = None
        self._surprised = False
        self._surprise_ns: int | None = None
        """The newest exchange that was not foreseen, or the first of all."""
        self._samples = 0
        self._origin_ns = 0
        self._base_ns = 0
        self._rtt_ns = 0
        self._newest_ns: int | None = None
        self._corridor = Corridor(window_s)

    @property
    def heard_ns(self) -> int | None:
        """Our clock at the newest exchange, None before the first."""
        return self._newest_ns

    def on_exchange(self, exchange: Exchange) -> bool:
        """Takes one exchange; True when it was the last proof of a clock step."""
        most_ns = exchange.most_ns
        # the two bounds are of different instants: an echo may be held for seconds
        drift_ns = round(SKEW_LIMIT * (exchange.received_ns - exchange.sent_ns))
        if most_ns is not None and most_ns + drift_ns + RESOLUTION_NS < exchange.least_ns - RESOLUTION_NS:
            # Their clock stepped between our packet and their answer: the echo speaks of the old time.
            exchange = msgspec.structs.replace(exchange, most_ns=None)
        direction = self._violates(exchange)
        if direction == 0:
            self.outliers += len(self._violations)
            self._violations.clear()
            self._take(exchange)
            return False
        self._violations.append(exchange)
        if len(self._violations) < STEP_COUNT:
            return False
        proofs, self._violations = self._violations, []
        self._restart()
        for proof in proofs:
            # Their clock jumped ahead: an echo of a packet from before we knew may speak of the old time.
            old = direction > 0 and proof.sent_ns < proofs[0].received_ns
            self._take(msgspec.structs.replace(proof, most_ns=None) if old else proof)
        return True

    def _violates(self, exchange: Exchange) -> int:
        """+1: their clock is impossibly far ahead of the prediction; −1: behind; 0: possible."""
        known = self.conversion
        if known is None or not known.samples:
            return 0
        now_ns = exchange.received_ns
        silent = self._newest_ns is None or now_ns - self._newest_ns >= SILENCE_NS
        estimate = self._estimate
        settled = estimate is not None and estimate.settled
        known_ns = known.likely_at_ns(now_ns) if settled and not silent else known.bound_at_ns(now_ns)
        margin_ns = STEP_MARGIN_NS + known_ns
        ahead_ns = exchange.least_ns - (known.to_remote(now_ns) - now_ns)
        if ahead_ns > margin_ns:
            return 1
        most_ns, sent_ns = exchange.most_ns, exchange.sent_ns
        behind_ns = ahead_ns if most_ns is None else known.to_remote(sent_ns) - sent_ns - most_ns
        if behind_ns > margin_ns and most_ns is not None:
            return -1
        if estimate is not None and settled:
            foreseen_ns = RESOLUTION_NS + (estimate.surprise_s - estimate.half_s) * 1e9
            if max(ahead_ns, behind_ns) > foreseen_ns:
                self._surprised = True
                self._surprise_ns = now_ns
        return 0

    def _take(self, exchange: Exchange) -> None:
        if not self._samples:
            self._origin_ns = exchange.received_ns
            self._base_ns = exchange.least_ns
            self._surprise_ns = exchange.received_ns
        self._samples += 1
        self._newest_ns = exchange.received_ns
        self._dirty = True
        base_ns = self._base_ns
        self._corridor.add_lower(
            (exchange.received_ns - self._origin_ns) / 1e9,
            (exchange.least_ns - base_ns - RESOLUTION_NS) / 1e9,
        )
        if exchange.most_ns is None:
            return
        rtt_ns = exchange.most_ns - exchange.least_ns
        self._rtt_ns = min(self._rtt_ns, rtt_ns) if self._rtt_ns else rtt_ns
        if exchange.received_ns - exchange.sent_ns <= self._window_s * 1e9:
            most_ns = exchange.most_ns + RESOLUTION_NS - self._base_ns
            self._corridor.add_upper((exchange.sent_ns - self._origin_ns) / 1e9, most_ns / 1e9)

    def _restart(self) -> None:
        """Another reading of one of the clocks: the function so far means nothing any more."""
        self._begin_again()
        self._doubted = None
        self.conversion = None
        self._step()

    def _step(self) -> None:
        self.steps += 1
        self.conv_epoch += 1

    def _begin_again(self) -> None:
        """Forgets all but the skew: an oscillator keeps its rate when its reading is set."""
        self._corridor = Corridor(self._window_s, self._corridor.skew)
        self._estimate = None
        self._surprised = False
        self._samples = 0
        self._rtt_ns = 0
        self._next_pause_s = FIRST_SOLVES_S
        self._solved_ns = None
        self._dirty = False

    def due_ns(self) -> int | None:
        """When the function should be solved again; None while nothing new has come."""
        if not self._dirty:
            return None
        if self._solved_ns is None:
            return self._newest_ns
        pause_s = min(EAGER_S, self._next_pause_s) if self._surprised else self._next_pause_s
        due_ns = self._solved_ns + round(pause_s * 1e9)
        if pause_s * 1e9 < TOGETHER_RATIO * TOGETHER_NS:
            return due_ns
        return -(-due_ns // TOGETHER_NS) * TOGETHER_NS

    def solve(self, now_ns: int) -> bool:
        """Brings the function up to date; True when that showed that a clock has stepped a little."""
        self._dirty = False
        breaks = self._corridor.breaks
        try:
            surprise_ns = now_ns if self._surprise_ns is None else self._surprise_ns
            search = now_ns - surprise_ns <= self._window_s * 1e9
            estimate = self._corridor.solve((now_ns - self._origin_ns) / 1e9, search=search)
        except NoLine:
            # A small step, or one wrong stamp: the function stays until new packets tell which it was.
            self._doubted = self.conversion
            self._begin_again()
            return False
        if self._corridor.breaks > breaks:
            self._doubted = self.conversion
        if estimate is None:
            self._solved_ns = None  # solved again with the next packet
            return False
        if self._surprised:
            self._next_pause_s = EAGER_S
        elif self._solved_ns is not None:
            self._next_pause_s *= 2
        longest_s = max(EAGER_S, estimate.span_s / SPAN_RATIO)
        self._next_pause_s = min(self._next_pause_s, longest_s, self._pause_s)
        self._surprised = False
        self._solved_ns = now_ns
        self._estimate = estimate
        found = self._function(estimate, now_ns)
        stepped = self._doubted is not None and not found.agrees(self._doubted, now_ns)
        self._doubted = None
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
            rtt_ns=self._rtt_ns,
        )
