"""Congestion window of the link to a neighbour, which follows the queueing delay, not the loss.

A radio loses packets that no queue dropped, so loss alone does not show congestion (RFC 9002 would stop at a
few packets). The sign is the growth of the round trip above its minimum, as in LEDBAT (RFC 6817); loss
counts only as far as it exceeds what the link loses anyway.
"""

from typing import Final

from swarmware.transport.retransmission.rtt import QueueDelay

TARGET_NS: Final = 25_000_000
"""Maximum queueing delay that the window fills; a command behind it still arrives fast."""
FALL_NS: Final = 17_000_000
"""Round trip with the queue that the window fills: if the link falls to a tenth of its rate at once, the
packets in flight need ten times as long, which shall be less than 200 ms."""
QUEUE_PACKETS: Final = 2
"""Minimum permitted queue, in packets."""
QUEUE_SHARE: Final = 4
"""Divisor of the round trip for the minimum permitted queue, which is small beside a long path's data."""
PACKET_BYTES: Final = 1240
WINDOW_FIRST: Final = 10 * PACKET_BYTES
"""RFC 9002, section 7.2."""
WINDOW_MIN: Final = 2 * PACKET_BYTES
WINDOW_MAX: Final = 2 * 1024 * 1024
BASE_NS: Final = 5_000_000_000
"""Interval of the minimum round trip, which is taken over the present and the former one."""
SAMPLES_MIN: Final = 4
"""Minimum samples in a round; fewer are too uncertain where delays scatter."""
NEWEST: Final = 8
"""Round trips that show the present queue (RFC 9406, section 4.2)."""
GROWTH: Final = 0.12
"""Growth of the window in a round with an empty queue."""
LOSS_PACKETS: Final = 60
"""Packets after which the loss is judged."""
LOSS_EXCESS: Final = 0.2
"""Loss in excess of the link's usual loss that counts as a full queue."""
PACING_GAIN: Final = 1.25
"""Gain of the pacing rate: the window is sent a little faster than in a round trip (RFC 9002, section
7.7)."""
BURST: Final = 4 * PACKET_BYTES
BUSY_NS: Final = TARGET_NS // 5
"""Queueing delay that shows a saturated link, unless half of the target is less."""
BUSY_ROUNDS: Final = 4
"""Round trips without a break in which packets were acknowledged."""
CAPACITY_NS: Final = 1_000_000_000
"""Time over which the measured capacity is a mean."""


class RateControl:
    """The congestion window of a link, and its pace."""

    def __init__(self, now_ns: int, usual_loss: float = 0.0, base_ns: int | None = None) -> None:
        """`base_ns`: round trip without a queue, as beacons measured it, or None if unknown."""
        self.window = float(WINDOW_FIRST)
        self.in_flight = 0
        self._usual_loss = usual_loss
        self._starting = True
        """True while the window doubles in each round, until a queue is measured."""
        self.delay = QueueDelay(BASE_NS, NEWEST, now_ns, base_ns)
        """Round trips of the last seconds: their minimum, and the queue that they show."""
        self._round_ns = now_ns
        self._samples = 0
        self._passed = 0
        """Bytes that left the link in this round, acknowledged or lost."""
        self._is_used = False
        """True if the window was the limit in this round."""
        self._arrived = 0
        """Bytes that were acknowledged in this round."""
        self.capacity_bytes_s: float | None = None
        """Bytes per second that arrived while the link was the limit, or None if it never was."""
        self.capacity_ns = now_ns
        """Instant of the last measurement of the capacity."""
        self._acknowledged_packets = 0
        self._lost_packets = 0
        self._allowance = float(BURST)
        """Bytes that the pace allows now."""
        self._paced_ns = now_ns

    def has_room(self, reserve: bool) -> bool:
        """Whether another packet may be in flight; `reserve` for packets with commands, which have
        priority."""
        return self.in_flight < (1.5 * self.window + BURST if reserve else self.window)

    def on_limited(self) -> None:
        """The window holds packets back."""
        self._is_used = True

    def wait_ns(self, smoothed_ns: int, now_ns: int) -> int:
        """Time until the pace allows the next packet, or 0 if it is allowed now."""
        pace = PACING_GAIN * self.window / max(smoothed_ns, 1_000_000)
        self._allowance = min(self._allowance + pace * (now_ns - self._paced_ns), BURST)
        self._paced_ns = now_ns
        if self._allowance > 0:
            return 0
        return int(-self._allowance / pace) + 1

    def on_sent(self, size: int) -> None:
        """A packet is in flight."""
        self.in_flight += size
        self._allowance -= size

    def on_round_trip(self, sample_ns: int, now_ns: int) -> None:
        """A round trip was measured."""
        self.delay.add(sample_ns, now_ns)
        self._samples += 1

    def on_acknowledged(self, size: int) -> None:
        """A packet has arrived."""
        self.in_flight -= size
        self._passed += size
        self._arrived += size
        self._acknowledged_packets += 1

    def on_lost(self, size: int) -> None:
        """A packet counts as lost."""
        self.in_flight -= size
        self._passed += size
        self._lost_packets += 1

    def on_spurious(self) -> None:
        """A packet that counted as lost has arrived."""
        self._lost_packets = max(0, self._lost_packets - 1)

    def on_link_loss(self, ratio: float) -> None:
        """Loss of the link as its beacons measure it."""
        self._usual_loss = max(self._usual_loss, ratio)

    def on_silence(self) -> None:
        """Nothing is acknowledged for several time-outs."""
        self.window = max(self.window / 2, WINDOW_MIN)
        self._starting = False

    def on_queue(self) -> None:
        """Traffic of another transport fills the queue of the link."""
        self.window = float(WINDOW_MIN)
        self._starting = False

    def _target_ns(self, base_ns: int, elapsed_ns: int) -> int:
        """Queueing delay that the window fills."""
        packet_ns = PACKET_BYTES * elapsed_ns // max(self._passed, PACKET_BYTES)
        return min(TARGET_NS, max(FALL_NS - base_ns, base_ns // QUEUE_SHARE, QUEUE_PACKETS * packet_ns))

    def on_round(self, smoothed_ns: int, now_ns: int) -> None:
        """Adapt the window after a round trip with enough samples."""
        if now_ns - self._round_ns < smoothed_ns or self._samples < SAMPLES_MIN:
            return
        queueing_ns, elapsed_ns = self.delay.queueing_ns, now_ns - self._round_ns
        base_ns = self.delay.minimum_ns or smoothed_ns
        target_ns = self._target_ns(base_ns, elapsed_ns)
        if (
            self._is_used
            and queueing_ns > min(BUSY_NS, target_ns // 2)
            and elapsed_ns < BUSY_ROUNDS * smoothed_ns
        ):
            self._on_busy(elapsed_ns, now_ns)
        if queueing_ns > target_ns:
            self._starting = False
            if self.window <= WINDOW_MIN:
                # two packets in flight fill no queue, so the link itself has become slower
                self.delay.restart()
            # Aim at half of the target queue; a single round never more than halves the window.
            fitting = self._passed / elapsed_ns * (base_ns + target_ns / 2)
            self.window = max(self.window / 2, min(self.window * 0.95, fitting), WINDOW_MIN)
        elif self._exceeds_usual_loss():
            self._starting = False
            self.window = max(self.window * 0.8, WINDOW_MIN)
        elif self._is_used:
            share = 1 - queueing_ns / target_ns
            # A beginning queue ends the doubling early: the next doubling would overshoot the target.
            if self._starting and share < 0.7:
                self._starting = False
            growth = self.window if self._starting else max(GROWTH * self.window, PACKET_BYTES) * share
            self.window = min(self.window + growth, WINDOW_MAX)
        self._round_ns = now_ns
        self._samples = self._passed = self._arrived = 0
        self._is_used = False

    def _on_busy(self, elapsed_ns: int, now_ns: int) -> None:
        """The link was the limit in this round, so that the arrived bytes show its capacity."""
        found = self._arrived * 1e9 / elapsed_ns
        before = found if self.capacity_bytes_s is None else self.capacity_bytes_s
        self.capacity_bytes_s = before + min(1.0, elapsed_ns / CAPACITY_NS) * (found - before)
        self.capacity_ns = now_ns

    def _exceeds_usual_loss(self) -> bool:
        packets = self._acknowledged_packets + self._lost_packets
        if packets < LOSS_PACKETS:
            return False
        loss = self._lost_packets / packets
        self._acknowledged_packets = self._lost_packets = 0
        exceeds = loss > self._usual_loss + LOSS_EXCESS
        # down at once, up slowly, so that a lasting loss counts as the link's own
        weight = 0.5 if loss < self._usual_loss else 0.1
        self._usual_loss += weight * (loss - self._usual_loss)
        return exceeds
