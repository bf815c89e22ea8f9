"""Numbers of the packets that arrived, and when they must be acknowledged."""

from typing import Final

from swarmd.broker.core.frames.reliable.packet import RANGES_MAX, Acknowledgement

ACK_DELAY_NS: Final = 4_000_000
"""Longest wait of an acknowledgement for a second packet, or for a packet of the own to ride in."""
ACK_EVERY: Final = 2
"""Packets after which an acknowledgement is sent at once (RFC 9000, section 13.2.2)."""


class ReceivedPackets:
    """Ranges of received packet numbers, and the pending acknowledgement of them."""

    __slots__ = ("_newest_ns", "_ranges", "_unanswered", "due_ns")

    def __init__(self) -> None:
        self._ranges: list[list[int]] = []
        """First and last number of each range, the newest first."""
        self._newest_ns = 0
        """When the packet with the highest number arrived."""
        self._unanswered = 0
        self.due_ns: int | None = None
        """Instant at which the acknowledgement must be sent, or None if none is pending."""

    def on_packet(self, number: int, is_answered: bool, now_ns: int, arrived_ns: int | None = None) -> None:
        """A packet with this number arrived, at `arrived_ns` if it waited for this process."""
        newest = self._ranges[0][1] if self._ranges else -1
        in_order = number == newest + 1
        if number > newest:
            self._newest_ns = now_ns if arrived_ns is None else arrived_ns
        self._insert(number)
        if not is_answered:
            return
        self._unanswered += 1
        if self._unanswered >= ACK_EVERY or not in_order:
            self.due_ns = now_ns
        elif self.due_ns is None:
            self.due_ns = now_ns + ACK_DELAY_NS

    def _insert(self, number: int) -> None:
        ranges = self._ranges
        at = 0
        while at < len(ranges) and number < ranges[at][0] - 1:
            at += 1
        if at == len(ranges) or number > ranges[at][1] + 1:
            ranges.insert(at, [number, number])
            del ranges[RANGES_MAX:]
            return
        ranges[at][0] = min(ranges[at][0], number)
        ranges[at][1] = max(ranges[at][1], number)
        if at + 1 < len(ranges) and ranges[at + 1][1] >= ranges[at][0] - 1:
            ranges[at][0] = ranges.pop(at + 1)[0]

    def present(self, now_ns: int) -> Acknowledgement | None:
        """The acknowledgement of all packets, if one is pending."""
        if not self._unanswered:
            return None
        ranges = tuple((first, last) for first, last in self._ranges)
        return Acknowledgement(ranges, max(0, now_ns - self._newest_ns))

    def on_acknowledged(self) -> None:
        """The acknowledgement is in a packet that is sent."""
        self._unanswered = 0
        self.due_ns = None
