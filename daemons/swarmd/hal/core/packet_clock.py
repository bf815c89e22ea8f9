"""The timing of a packet recording: which packets are due, and when exactly each of them was."""

from collections.abc import Iterator
from typing import Final

import msgspec

_NS: Final = 1_000_000_000
_CATCH_UP_S: Final = 1.0
"""A longer stall is not caught up: a real device would have gone on without us."""


class Due(msgspec.Struct, frozen=True, gc=False):
    """One packet of the recording."""

    index: int
    """Its place in the recording."""
    stamp_ns: int
    """The instant at which the device sends it."""


class PacketClock:
    """Packets at a constant rate since the start; the k-th is due at start + k / rate, rounded to 1 ns.

    So the mean rate is exact however the calls come.
    """

    __slots__ = ("_count", "_loop", "_rate_uhz", "_sent", "_start_ns", "lost")

    def __init__(self, rate_hz: float, count: int, start_ns: int, *, loop: bool) -> None:
        self._rate_uhz = round(rate_hz * 1_000_000)
        self._count = count
        self._start_ns = start_ns
        self._loop = loop
        self._sent = 0
        self.lost = 0
        """Packets that fell out in stalls."""

    @property
    def finished(self) -> bool:
        """The recording is at its end and does not begin again."""
        return not self._loop and self._sent >= self._count

    def _stamp_ns(self, k: int) -> int:
        return self._start_ns + k * _NS * 1_000_000 // self._rate_uhz

    def due(self, now_ns: int) -> Iterator[Due]:
        """The packets up to now, oldest first."""
        end = (now_ns - self._start_ns) * self._rate_uhz // (_NS * 1_000_000) + 1
        most = max(1, int(_CATCH_UP_S * self._rate_uhz) // 1_000_000)
        if end - self._sent > most:
            self.lost += end - most - self._sent
            self._sent = end - most
        if not self._loop:
            end = min(end, self._count)
        while self._sent < end:
            yield Due(self._sent % self._count, self._stamp_ns(self._sent))
            self._sent += 1
