"""What carries the frames to a neighbour, its connections or datagrams: from loss and delay of the link.

TCP fills whatever buffer it gets, in the kernel and before the link. So a connection has a small one, which
grows where the buffer, not the link, holds frames back. Where frames wait while the kernel measures a queue,
datagrams take them.
"""

from typing import Final

import msgspec

from swarmd.broker.config import FrameCarrier

LOSSY: Final = 0.05
"""Smoothed loss of the beacons from which on frames travel in datagrams."""
CLEAN: Final = 0.01
"""Smoothed loss below which they travel over TCP again, after `CLEAN_NS`."""
CLEAN_NS: Final = 20_000_000_000
QUEUE_NS: Final = 60_000_000
"""Round trip above its minimum that shows a queue, in `QUEUED` measurements in a row: some times what the
window of a reliable link fills, and more than the usual delay of TCP's acknowledgements (40 ms)."""
QUEUED: Final = 2
BASE_RISE: Final = 64
"""Part of its excess by which the minimum of the round trip follows each second: delays may have grown."""
WEIGHT: Final = 0.4
"""Weight of the newest second's loss: at 30 % the first second is enough, a single loss is not."""
BUFFER_MIN: Final = 2304
"""First send buffer of a connection, the least that Linux knows: at most 9 kB are on the way then, which a
link that falls to 0.5 Mbit/s has carried after 0.15 s (`tests/integration/broker/falling.py`)."""
BUFFER_MAX: Final = 32 * 1024
BUFFER_GROWTH: Final = 1.5
FREE_NS: Final = 10_000_000
"""Round trip above its minimum up to which the buffer, not the link, holds back frames that wait."""


class LinkQuality(msgspec.Struct, frozen=True):
    """What beacons measured of the link to a neighbour."""

    loss: float
    """Loss of the worse direction."""
    rtt_ns: int = 0
    """0: not measured."""


class ConnectionDelay(msgspec.Struct, frozen=True):
    """Round trips of a connection as the kernel measures them."""

    smoothed_ns: int
    min_ns: int
    """Minimum of the last minutes: measured when the connection was opened, too, before it filled a queue."""

    @property
    def excess_ns(self) -> int:
        """Smoothed round trip above the minimum."""
        return max(0, self.smoothed_ns - self.min_ns)


class Carrier:
    """What carries the frames to one neighbour, and what was measured for that choice."""

    def __init__(self) -> None:
        self.by_datagram = False
        self.loss = 0.0
        """Smoothed."""
        self.base_ns: int | None = None
        """Minimum of the round trip of beacons; None: not measured."""
        self.queued_rtt_ns: int | None = None
        """Round trip with the queue because of which the datagrams began, and which is still before them;
        None: they began for another reason."""
        self.blocked_until_ns = 0
        """Datagrams do not reach the neighbour; until then it gets none."""
        self.buffer_bytes = BUFFER_MIN
        """Send buffer of its connections."""
        self._rtt_ns = 0
        """The last one."""
        self._queued = 0
        """Seconds in a row with a queue."""
        self._held = 0
        """Measurements of the connections in a row with a queue."""
        self._clean_since_ns: int | None = None

    @property
    def is_clean(self) -> bool:
        """Nearly no beacon is lost or late, and frames do not wait behind a queue."""
        return not (self.by_datagram or self._queued or self._held) and self.loss <= CLEAN

    @property
    def is_queued(self) -> bool:
        """Whether the last measurements show a queue."""
        return self._queued >= QUEUED or self._held >= QUEUED

    def wants_datagrams(self, kind: FrameCarrier, now_ns: int) -> bool:
        """Whether the link loses or delays too much for its connections."""
        if kind is FrameCarrier.TCP or now_ns < self.blocked_until_ns:
            return False
        return self.loss >= LOSSY or self.is_queued or kind is FrameCarrier.UDP

    def on_quality(self, quality: LinkQuality) -> None:
        """What beacons measured in the last second."""
        self.loss += WEIGHT * (quality.loss - self.loss)
        rtt_ns = quality.rtt_ns
        if not rtt_ns:
            return
        base_ns, self._rtt_ns = self.base_ns, rtt_ns
        if base_ns is None or rtt_ns <= base_ns:
            self.base_ns = rtt_ns
        elif not self.by_datagram:
            self.base_ns = base_ns + (rtt_ns - base_ns) // BASE_RISE
        self._queued = self._queued + 1 if rtt_ns - (self.base_ns or 0) > QUEUE_NS else 0

    def on_connection(self, delay: ConnectionDelay | None, is_waiting: bool) -> int | None:
        """What was measured of the connections, and whether frames wait for them; the send buffer that they
        get, None: the present one."""
        if not is_waiting or delay is None:
            self._held = 0
            return None
        self._rtt_ns = delay.smoothed_ns
        if self.base_ns is None or self.base_ns > delay.min_ns + QUEUE_NS:
            self.base_ns = delay.min_ns  # the first beacons were already behind a queue
        if delay.excess_ns > QUEUE_NS:
            self._held += 1
            self.buffer_bytes = BUFFER_MIN
            return BUFFER_MIN
        self._held = 0
        if delay.excess_ns > FREE_NS:
            return None
        self.buffer_bytes = min(round(BUFFER_GROWTH * self.buffer_bytes), BUFFER_MAX)
        return self.buffer_bytes

    def begin_datagrams(self) -> None:
        """Frames take datagrams from now on."""
        self.by_datagram, self._clean_since_ns = True, None
        self.queued_rtt_ns = self._rtt_ns if self.is_queued else None
        self._queued = self._held = 0

    def on_block(self, until_ns: int) -> None:
        """The neighbour does not acknowledge datagrams: it gets none until then."""
        self.by_datagram, self.blocked_until_ns = False, until_ns

    def end_when_clean(self, is_used: bool, now_ns: int) -> None:
        """Returns to the connections once nothing was lost, and no frames waited (`is_used`), for a while."""
        if self.loss > CLEAN or is_used:
            self._clean_since_ns = None
        elif self._clean_since_ns is None:
            self._clean_since_ns = now_ns
        elif now_ns - self._clean_since_ns >= CLEAN_NS:
            self.by_datagram = False
