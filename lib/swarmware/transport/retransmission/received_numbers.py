"""Numbers that have arrived: the filter of duplicates."""

from swarmware.transport.retransmission.policy import UNLIMITED


class ReceivedNumbers:
    """Received numbers from a floor on, one bit each; all numbers below the floor count as received."""

    __slots__ = ("_bits", "_span", "floor")

    def __init__(self, floor: int = 0, span: int = UNLIMITED) -> None:
        """`span`: a larger number raises the floor, so that at most this many numbers have a bit."""
        self.floor = floor
        self._span = span
        self._bits = 0

    def __contains__(self, number: int) -> bool:
        at = number - self.floor
        return at < 0 or self._bits >> at & 1 == 1

    def add(self, number: int) -> None:
        """The number has arrived."""
        if number - self.floor >= self._span:
            self.raise_floor(number - self._span + 1)
        if number >= self.floor:
            self._bits |= 1 << number - self.floor

    def raise_floor(self, floor: int) -> None:
        """Numbers below this one count as received from now on."""
        if floor > self.floor:
            self._bits >>= floor - self.floor
            self.floor = floor
