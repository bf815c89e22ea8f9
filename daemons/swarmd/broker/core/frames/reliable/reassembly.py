"""Messages of a neighbour put together from their pieces, each delivered once."""

from typing import Final

from swarmd.broker.core.frames.reliable.packet import Piece
from swarmware.errors import WireError
from swarmware.transport.retransmission.received_numbers import ReceivedNumbers

SPAN_MAX: Final = 4096
"""Messages from the first incomplete message to the newest message with a received piece."""
BYTES_MAX: Final = 32 * 1024 * 1024
"""Bytes of incomplete messages of one neighbour."""


class _Partial:
    __slots__ = ("data", "missing", "offsets")

    def __init__(self, total: int) -> None:
        self.data = bytearray(total)
        self.missing = total
        self.offsets: dict[int, int] = {}
        """Pieces that arrived: their length by offset. A sender repeats pieces as they were."""


class Reassembly:
    """Incomplete messages, and the numbers of complete ones."""

    def __init__(self) -> None:
        self._complete = ReceivedNumbers()
        self._partial: dict[int, _Partial] = {}
        self._bytes = 0

    def has_room(self, pieces: tuple[Piece, ...]) -> bool:
        """Whether the messages of these pieces can be kept; a packet without room is not acknowledged."""
        added = sum(
            piece.total
            for piece in pieces
            if len(piece.data) < piece.total and piece.message not in self._partial
        )
        return not added or self._bytes + added <= BYTES_MAX

    def on_floor(self, floor: int) -> None:
        """The sender has completed all messages before this one."""
        if floor > self._complete.floor:
            self._complete.raise_floor(floor)
            for number in [number for number in self._partial if number < floor]:
                self._drop(number)

    def on_piece(self, piece: Piece) -> bytes | None:
        """A piece arrived; the message that it completes.

        Raises: WireError for a piece that does not fit the others of its message.
        """
        number = piece.message
        if number in self._complete:
            return None
        floor = self._complete.floor
        if number - floor > SPAN_MAX:
            raise WireError(f"message {number}: more than {SPAN_MAX} after the incomplete one {floor}")
        if len(piece.data) == piece.total:
            self._complete.add(number)
            return piece.data
        return self._add(piece)

    def _add(self, piece: Piece) -> bytes | None:
        partial = self._partial.get(piece.message)
        if partial is None:
            partial = self._partial[piece.message] = _Partial(piece.total)
            self._bytes += piece.total
        length, total = len(piece.data), len(partial.data)
        known = partial.offsets.get(piece.offset)
        if total != piece.total or known not in (None, length):
            raise WireError(f"message {piece.message}: its pieces do not fit each other")
        if known is not None:
            return None
        partial.offsets[piece.offset] = length
        partial.data[piece.offset : piece.offset + length] = piece.data
        partial.missing -= length
        if partial.missing > 0:
            return None
        self._complete.add(piece.message)
        whole = bytes(partial.data)
        self._drop(piece.message)
        if partial.missing < 0:
            raise WireError(f"message {piece.message}: its pieces overlap")
        return whole

    def _drop(self, number: int) -> None:
        self._bytes -= len(self._partial.pop(number).data)
