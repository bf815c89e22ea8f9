"""The bit rate of a source: what the link carries, from the queue before it and from reports of loss.

The encoder of a video uses it, and each stream whose rate follows its link.
"""

from collections import deque
from typing import Final

import msgspec

RATE_MIN: Final = 64_000
"""Bit/s below which H.264 of a camera shows nothing."""
BEGIN_BIT_S: Final = 1_000_000
"""First rate where the link is not known, or less."""
STEP_NS: Final = 200_000_000
"""Between two increases, and between two decreases for the same queue."""
QUEUE_NS: Final = 60_000_000
"""Queue, in the link or before it, that lowers the rate: a picture at 25 Hz may be spread over 40 ms."""
DECREASE: Final = 0.85
"""Factor on the arriving rate, so that the queue drains (as in Google's congestion control, section 5.5)."""
INCREASE: Final = 0.08
BEYOND_RECEIVED: Final = 1.5
"""Rate above what arrives: a quiet picture needs less, and says nothing about the link."""
MEASURED_NS: Final = 500_000_000
LOSS_HIGH: Final = 0.1
LOSS_LOW: Final = 0.02
"""Where receivers report only loss and round trip: as in Google's congestion control, section 6."""
RECORDED: Final = 32
"""Newest changes that are shown."""


class RateChange(msgspec.Struct, frozen=True):
    """One change of the rate."""

    at_ns: int
    bit_s: int
    reason: str
    is_rise: bool = False
    """The link was free."""


class BitrateControl:
    """Fits the bit rate to the link, unless it is pinned."""

    def __init__(
        self,
        max_bit_s: int,
        pinned: bool,
        now_ns: int,
        *,
        begin_bit_s: int = BEGIN_BIT_S,
        min_bit_s: int = RATE_MIN,
    ) -> None:
        self.max_bit_s = max_bit_s
        self._min_bit_s = min_bit_s
        self.pinned = pinned
        self.bit_s = max_bit_s if pinned else min(max_bit_s, begin_bit_s)
        self.changes: deque[RateChange] = deque(maxlen=RECORDED)
        self._changed_ns = now_ns
        self._received: deque[tuple[int, int]] = deque()
        self._received_bytes = 0
        self._base_ns: int | None = None
        self._set(self.bit_s, "pinned" if pinned else "begin", now_ns)

    def pin(self, bit_s: int, pinned: bool, now_ns: int) -> None:
        """An operator sets the rate; `pinned`: it stays, else it is the highest."""
        self.max_bit_s, self.pinned = bit_s, pinned
        # an adaptive rate starts where it is: the link has not changed
        rate = bit_s if pinned else min(self.bit_s, bit_s)
        self._set(rate, "pinned" if pinned else "adaptive", now_ns)

    def on_received(self, size: int, now_ns: int) -> None:
        """Bytes that have arrived."""
        self._received.append((now_ns, size))
        self._received_bytes += size

    def on_queue(self, queueing_ns: int, waiting_ns: int, now_ns: int) -> None:
        """The queue in the link, and the age of the oldest packet that waits before it."""
        received = self._received_bit_s(now_ns)
        if self.pinned or now_ns - self._changed_ns < STEP_NS:
            return
        if max(queueing_ns, waiting_ns) > QUEUE_NS:
            # what arrived while the queue was filled is what the link carries
            fitting = min(self.bit_s, received) * DECREASE if received else self.bit_s / 2
            self._set(int(fitting), f"queue of {max(queueing_ns, waiting_ns) // 1_000_000} ms", now_ns)
        elif received:
            limit = max(received * BEYOND_RECEIVED, self.bit_s)
            self._set(int(min(self.bit_s * (1 + INCREASE), limit)), "free", now_ns, is_rise=True)

    def on_report(self, lost_ratio: float, round_trip_ns: int | None, now_ns: int) -> None:
        """Loss and round trip from a receiver that does not report arrival times."""
        if round_trip_ns is not None:
            known = self._base_ns
            self._base_ns = round_trip_ns if known is None else min(known, round_trip_ns)
        if self.pinned or now_ns - self._changed_ns < STEP_NS:
            return
        queueing_ns = 0 if round_trip_ns is None else round_trip_ns - (self._base_ns or 0)
        if queueing_ns > QUEUE_NS:
            self._set(int(self.bit_s * DECREASE), f"queue of {queueing_ns // 1_000_000} ms", now_ns)
        elif lost_ratio > LOSS_HIGH:
            self._set(int(self.bit_s * (1 - lost_ratio / 2)), f"loss of {lost_ratio:.0%}", now_ns)
        elif lost_ratio < LOSS_LOW:
            self._set(int(self.bit_s * (1 + INCREASE)), "free", now_ns, is_rise=True)

    def on_silence(self, now_ns: int) -> None:
        """The receiver reports no longer."""
        if not self.pinned:
            self._set(self.bit_s // 2, "no reports", now_ns)

    def on_free(self, now_ns: int) -> None:
        """The link has had no queue for some time: no limit is needed."""
        if not self.pinned:
            self._set(self.max_bit_s, "free", now_ns, is_rise=True)

    def _received_bit_s(self, now_ns: int) -> float:
        while self._received and self._received[0][0] < now_ns - MEASURED_NS:
            self._received_bytes -= self._received.popleft()[1]
        # one packet has no rate
        if len(self._received) < 2:
            return 0.0
        return self._received_bytes * 8e9 / MEASURED_NS

    def _set(self, bit_s: int, reason: str, now_ns: int, *, is_rise: bool = False) -> None:
        # an operator's maximum may be below the minimum of the source
        bit_s = max(min(bit_s, self.max_bit_s), min(self._min_bit_s, self.max_bit_s))
        self._changed_ns = now_ns
        if bit_s == self.bit_s and self.changes:
            return
        self.bit_s = bit_s
        if is_rise and self.changes and self.changes[-1].is_rise:
            self.changes.pop()  # one line for a rise
        self.changes.append(RateChange(now_ns, bit_s, reason, is_rise))
