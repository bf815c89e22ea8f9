"""The choice of a carrier for a neighbour, connections or datagrams, from loss and delay of the link.

Where frames wait while the kernel measures a queue, or no connection can be opened, datagrams take them.
"""

from typing import Final

import msgspec

from swarmd.broker.config import FrameCarrier
from swarmd.broker.core.frames.send_buffer import SendBuffer
from swarmd.broker.core.swarm.links.link import ConnectionDelay

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
UNOPENED_NS: Final = 3_000_000_000
"""Time for which frames wait for a connection before datagrams take them: a firewall may drop TCP alone."""


class LinkQuality(msgspec.Struct, frozen=True):
    """Measurement of the link to a neighbour by beacons."""

    loss: float
    """Share of beacons that were lost on the way, in the worse direction; late ones do not count."""
    rtt_ns: int = 0
    """Round trip, or 0 if not measured."""
    silence: float = 0.0
    """Share of lost beacons if overdue ones count as lost."""
    is_opening: bool = False
    """Whether a connection to it is not open."""


class CarrierChoice:
    """The carrier of the frames to one neighbour, with hysteresis, and the measurements that decide it."""

    def __init__(self) -> None:
        self.by_datagram = False
        self.loss = 0.0
        """Smoothed loss of the beacons, in the worse direction."""
        self.base_ns: int | None = None
        """Minimum of the round trip of beacons, or None if not measured."""
        self.queued_rtt_ns: int | None = None
        """Round trip with the queue because of which the datagrams began, and which is still before them, or
        None if they began for another reason."""
        self.blocked_until_ns = 0
        """Datagrams do not reach the neighbour; until then it gets none."""
        self._buffer = SendBuffer()
        self._rtt_ns = 0
        """Last measured round trip, of beacons or connections."""
        self._queued = 0
        """Seconds in a row with a queue."""
        self._held = 0
        """Measurements of the connections in a row with a queue."""
        self._unopened_since_ns: int | None = None
        """Since when frames wait although no connection is open."""
        self._is_unopened = False
        """Frames have waited for an open connection for too long."""
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
        """Whether the link loses or delays too much for its connections, or they cannot be opened."""
        if kind is FrameCarrier.TCP or now_ns < self.blocked_until_ns:
            return False
        return self.loss >= LOSSY or self.is_queued or self._is_unopened or kind is FrameCarrier.UDP

    def on_quality(self, quality: LinkQuality) -> None:
        """Takes the measurement of the last second by beacons."""
        self.loss += WEIGHT * (quality.loss - self.loss)
        rtt_ns = quality.rtt_ns
        if not rtt_ns:
            return
        base_ns, self._rtt_ns = self.base_ns, rtt_ns
        # in datagrams the minimum is kept; their own queue would slowly become the normal round trip
        if base_ns is None or rtt_ns <= base_ns:
            self.base_ns = rtt_ns
        elif not self.by_datagram:
            self.base_ns = base_ns + (rtt_ns - base_ns) // BASE_RISE
        self._queued = self._queued + 1 if rtt_ns - (self.base_ns or 0) > QUEUE_NS else 0

    def on_connection(self, delay: ConnectionDelay | None, is_waiting: bool, now_ns: int) -> int | None:
        """Takes a measurement of the connections, and whether frames wait for them; returns the new size
        of their send buffer, or None to keep it."""
        self._on_opening(is_waiting and delay is None, now_ns)
        if not is_waiting or delay is None:
            self._held = 0
            return None
        self._rtt_ns = delay.smoothed_ns
        if self.base_ns is None or self.base_ns > delay.min_ns + QUEUE_NS:
            self.base_ns = delay.min_ns  # the first beacons were already behind a queue
        if self._buffer.queue_ns(delay) > QUEUE_NS:
            self._held += 1
            return self._buffer.shrink()
        self._held = 0
        return self._buffer.on_waiting(delay, now_ns)

    def _on_opening(self, is_unopened: bool, now_ns: int) -> None:
        if not is_unopened:
            self._unopened_since_ns = None
        elif self._unopened_since_ns is None:
            self._unopened_since_ns = now_ns
        since_ns = self._unopened_since_ns
        self._is_unopened = since_ns is not None and now_ns - since_ns >= UNOPENED_NS

    def begin_datagrams(self) -> None:
        """Frames take datagrams from now on."""
        self.by_datagram, self._clean_since_ns = True, None
        self.queued_rtt_ns = self._rtt_ns if self.is_queued else None
        self._queued = self._held = 0
        self._unopened_since_ns, self._is_unopened = None, False

    def on_block(self, until_ns: int) -> None:
        """The neighbour does not acknowledge datagrams, so it gets none until then."""
        self.by_datagram, self.blocked_until_ns = False, until_ns

    def end_when_clean(self, is_used: bool, now_ns: int) -> None:
        """Returns to the connections once nothing was lost, and no frames waited (`is_used`), for a while."""
        # far below the loss at which datagrams begin, and for long; a link at its edge must not alternate
        if self.loss > CLEAN or is_used:
            self._clean_since_ns = None
        elif self._clean_since_ns is None:
            self._clean_since_ns = now_ns
        elif now_ns - self._clean_since_ns >= CLEAN_NS:
            self.by_datagram = False
