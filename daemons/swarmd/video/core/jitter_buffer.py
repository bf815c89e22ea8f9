"""The jitter buffer: packets in order; a missing one is waited for, then it is a gap."""

from typing import Final

import msgspec

from swarmd.video.core.rtp_packet import RtpPacket

PACKETS_MAX: Final = 1024
"""Packets that wait for a missing one: more than this and it counts as lost."""
RESTART: Final = 3000
"""Step in the numbers that is not a loss but another beginning (RFC 3550, appendix A.1: MAX_DROPOUT)."""


class OrderedPacket(msgspec.Struct, frozen=True):
    """A packet in its order."""

    packet: RtpPacket
    lost: int = 0
    """Packets missing before it."""


class JitterBuffer:
    """Reorders packets by their numbers."""

    def __init__(self, wait_ns: int) -> None:
        """`wait_ns`: how long a missing packet is waited for."""
        self._wait_ns = wait_ns
        self._waiting: dict[int, tuple[RtpPacket, int]] = {}
        self._next: int | None = None
        self.late = 0
        """Packets that came after they counted as lost."""
        self.duplicates = 0

    def put(self, number: int, packet: RtpPacket, now_ns: int) -> list[OrderedPacket]:
        """Take a packet; those that are in order now."""
        if self._next is None or abs(number - self._next) > RESTART:
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
        """Packets whose predecessors were waited for in vain."""
        return self._ordered(now_ns)

    def deadline_ns(self) -> int | None:
        """When the first gap counts as lost; None: nothing waits."""
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
