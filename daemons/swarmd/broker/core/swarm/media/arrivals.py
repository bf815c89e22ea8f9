"""The loss of one medium, from the numbers of what arrived over it."""

from typing import Final

WINDOW: Final = 32
"""Numbers over which loss is measured."""
_MASK: Final = (1 << WINDOW) - 1
EXPECTED_MIN: Final = 8
"""Minimum of expected numbers: one datagram after a silence does not prove a perfect medium."""
_FULL: Final = 255


class Arrivals:
    """The last numbers of a sender that arrived; numbers have 16 bits."""

    __slots__ = ("_expected", "_top", "_window")

    def __init__(self) -> None:
        self._top = -1
        self._window = 0
        self._expected = 0

    def on_number(self, number: int) -> None:
        """A datagram with this number has arrived."""
        number &= 0xFFFF
        ahead = (number - self._top) & 0xFFFF
        if self._top < 0 or WINDOW < ahead < 0x10000 - WINDOW:
            # the first one, or the sender has started again
            self._top, self._window, self._expected = number, 1, 1
        elif ahead >= 0x8000:
            self._window |= 1 << (0x10000 - ahead) & _MASK
        elif ahead:
            self._top = number
            self._window = (self._window << ahead | 1) & _MASK
            self._expected = min(self._expected + ahead, WINDOW)

    @property
    def quality(self) -> int:
        """Share of the last numbers that arrived, in 1/255."""
        expected = max(EXPECTED_MIN, self._expected)
        return min(round(_FULL * self._window.bit_count() / expected), _FULL)
