"""The jitter buffer, which puts packets in order; a missing packet becomes a gap after a wait."""

from typing import Final

import msgspec

from swarmd.video.core.rtp_packet import RtpPacket

PACKETS_MAX: Final = 1024
"""Maximum number of packets that wait for a missing packet before it counts as lost."""
RESTART: Final = 3000
"""Step in the sequence numbers that is a restart, not a loss (RFC 3550, appendix A.1: MAX_DROPOUT)."""


class OrderedPacket(msgspec.Struct, frozen=True):
    """A packet in sequence, with the size of the gap before it."""

    packet: RtpPacket
    lost: int = 0
    """Number of lost packets before this packet."""


class JitterBuffer:
    """Reorders packets by their sequence numbers."""

    def __init__(self, wait_ns: int) -> None:
        """`wait_ns`: time to wait for a missing packet."""
        self._wait_ns = wait_ns
        self._waiting: dict[int, tuple[RtpPacket, int]] = {}
        self._next: int | None = None
        self.late = 0
        """Number of packets that arrived after they counted as lost."""
        self.duplicates = 0

    def put(self, number: int, packet: RtpPacket, now_ns: int) -> list[OrderedPacket]:
        """Takes a packet; returns the packets that are now in sequence."""
        if self._next is None or abs(number - self._next) > RESTART:
            # a sender that has started again has no use for the old packets
            self._waiting.clear()
            self._next = number
        if number < self._next:
            self.late += 1
            return []
        if number in self._waiting:
            self.duplicates += 1
            return []
        self._waiting[number] = (packet, now_ns)
        return self._ordered(now_ns)

    def on_due(self, now_ns: int) -> list[OrderedPacket]:
        """Returns the packets behind a gap whose wait is over."""
        return self._ordered(now_ns)

    def deadline_ns(self) -> int | None:
        """Instant at which the first gap counts as lost, or None if no packet waits."""
        if not self._waiting:
            return None
        return self._waiting[min(self._waiting)][1] + self._wait_ns

    def _ordered(self, now_ns: int) -> list[OrderedPacket]:
        out: list[OrderedPacket] = []
        while self._waiting and self._next is not None:
            lost = 0
            if self._next not in self._waiting:
                first = min(self._waiting)
                if now_ns < self._waiting[first][1] + self._wait_ns and len(self._waiting) < PACKETS_MAX:
                    break
                lost, self._next = first - self._next, first
            packet, _ = self._waiting.pop(self._next)
            out.append(OrderedPacket(packet, lost))
            self._next += 1
        return out
