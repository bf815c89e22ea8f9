"""Pacing of a serial line: what is written never waits longer in the driver than the next datagram."""

from collections import deque
from typing import Final

from swarmd.broker.core.swarm.media.line_frames import BITS, line_bytes

LEAD_NS: Final = 2_000_000
"""Time before the line is free at which the next datagram is written, so that no timer leaves it idle."""
BEACON_SHARE: Final = 0.5
"""Share of the line for beacons; a beacon that must wait is replaced by the next one."""
QUEUE_NS: Final = 500_000_000
"""Time on the line of the packets that wait; more would only be late."""
QUEUE_MIN: Final = 4
"""Packets that may wait on any line."""


class LineQueue:
    """Datagrams that wait for a line: beacons within their share, then urgent frames, then packets."""

    def __init__(self, baud: int) -> None:
        self._byte_ns = BITS * 1_000_000_000 / baud
        self._beacon: bytes | None = None
        self._beacon_from_ns: int | None = None
        """Earliest instant of the next beacon, or None for at once."""
        self._urgent: deque[bytes] = deque()
        self._packets: deque[bytes] = deque()
        self._free_ns: int | None = None
        """When the line has sent all written bytes, or None before the first."""
        self.replaced_beacons = 0
        self.dropped = 0
        """Frames for which there was no room."""

    def put_beacon(self, datagram: bytes) -> None:
        """Takes a beacon to be sent; it replaces a beacon that still waits, which is stale."""
        self.replaced_beacons += self._beacon is not None
        self._beacon = datagram

    def put(self, datagram: bytes, *, urgent: bool) -> bool:
        """An urgent frame or a packet waits; False when there is no room."""
        queue = self._urgent if urgent else self._packets
        waiting_ns = sum(map(self._duration_ns, queue)) + self._duration_ns(datagram)
        if len(queue) >= QUEUE_MIN and waiting_ns > QUEUE_NS:
            self.dropped += 1
            return False
        queue.append(datagram)
        return True

    def take(self, now_ns: int) -> bytes | None:
        """Removes and returns the next frame when the line is free for it."""
        if self._free_ns is not None and now_ns < self._free_ns - LEAD_NS:
            return None
        datagram = self._next(now_ns)
        if datagram is None:
            return None
        duration_ns = self._duration_ns(datagram)
        begin_ns = now_ns if self._free_ns is None else max(now_ns, self._free_ns)
        self._free_ns = begin_ns + duration_ns
        if datagram is self._beacon:
            self._beacon = None
            self._beacon_from_ns = begin_ns + round(duration_ns / BEACON_SHARE)
        return datagram

    def _duration_ns(self, datagram: bytes) -> int:
        return round(line_bytes(len(datagram)) * self._byte_ns)

    def _next(self, now_ns: int) -> bytes | None:
        if self._beacon is not None and (self._beacon_from_ns is None or now_ns >= self._beacon_from_ns):
            return self._beacon
        if self._urgent:
            return self._urgent.popleft()
        return self._packets.popleft() if self._packets else None

    def deadline_ns(self, now_ns: int) -> int | None:
        """When `take` has the next frame, or None if nothing waits."""
        free_ns = now_ns if self._free_ns is None else max(now_ns, self._free_ns - LEAD_NS)
        if self._urgent or self._packets:
            return free_ns
        if self._beacon is None:
            return None
        return free_ns if self._beacon_from_ns is None else max(free_ns, self._beacon_from_ns)

    def clear(self) -> None:
        """The line was unplugged: what waited is outdated."""
        self._beacon = self._free_ns = self._beacon_from_ns = None
        self._urgent.clear()
        self._packets.clear()
