"""Timing of a packet recording, with the due packets and the exact instant of each."""

from collections.abc import Iterator
from typing import Final

import msgspec

_NS: Final = 1_000_000_000
_CATCH_UP_S: Final = 1.0
"""Maximum stall that is caught up, because a real device does not wait for its reader."""


class Due(msgspec.Struct, frozen=True, gc=False):
    """One packet of the recording that is due."""

    index: int
    """Index of the packet in the recording."""
    stamp_ns: int
    """Instant at which the recorded device sends the packet."""


class PacketClock:
    """Packets at a constant rate; packet k is due at start + k / rate, rounded to 1 ns.

    The mean rate is exact, independent of the times of the calls.
    """

    __slots__ = ("_count", "_loop", "_rate_uhz", "_sent", "_start_ns", "lost")

    def __init__(self, rate_hz: float, count: int, start_ns: int, *, loop: bool) -> None:
        self._rate_uhz = round(rate_hz * 1_000_000)
        self._count = count
        self._start_ns = start_ns
        self._loop = loop
        self._sent = 0
        self.lost = 0
        """Number of packets lost in stalls."""

    def _stamp_ns(self, k: int) -> int:
        return self._start_ns + k * _NS * 1_000_000 // self._rate_uhz

    def due(self, now_ns: int) -> Iterator[Due]:
        """Packets that are due up to now, the oldest first."""
        end = (now_ns - self._start_ns) * self._rate_uhz // (_NS * 1_000_000) + 1
        max_packets = max(1, int(_CATCH_UP_S * self._rate_uhz) // 1_000_000)
        # a long stall skips packets, as the kernel's buffer of a real device would overflow
        if end - self._sent > max_packets:
            self.lost += end - max_packets - self._sent
            self._sent = end - max_packets
        if not self._loop:
            end = min(end, self._count)
        while self._sent < end:
            yield Due(self._sent % self._count, self._stamp_ns(self._sent))
            self._sent += 1
