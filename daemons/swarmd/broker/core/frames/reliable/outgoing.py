"""Frames to a neighbour as numbered messages: which piece is sent next, and which have arrived."""

from collections import deque
from collections.abc import Sequence
from typing import Final

import msgspec

from swarmd.broker.core.frames.reliable.packet import (
    HEAD_BYTES,
    PACKET_MAX,
    PIECE_BYTES,
    WHOLE_BYTES,
    Piece,
    piece_bytes,
)
from swarmd.broker.core.frames.reliable.reassembly import SPAN_MAX
from swarmd.broker.core.frames.send_queue import Priority, QueuedFrame, SendQueue
from swarmware.model.frame import Frame

ROOM: Final = PACKET_MAX - HEAD_BYTES
SPLIT_MIN: Final = 128
"""Smallest first piece of a message in a packet that has others."""
COMMANDS: Final = (Priority.URGENT, Priority.CONTROL)

Identity = tuple[int, int, int, int, int]


class _OutgoingMessage(msgspec.Struct):
    number: int
    rank: Priority
    queued: QueuedFrame
    missing: int
    """Bytes that have not arrived."""
    next_offset: int = 0
    arrived: set[int] = msgspec.field(default_factory=set)
    """Offsets of the pieces that arrived."""


class OutgoingMessages:
    """The queue of frames for a neighbour, and the messages that have begun."""

    def __init__(self) -> None:
        self._queue = SendQueue()
        self._identities: set[Identity] = set()
        """Frames that wait or are in flight: a copy that their sender retransmits is not needed."""
        self._messages: dict[int, _OutgoingMessage] = {}
        self._next_number = 0
        self.arrived_frames = 0
        self.repeated_bytes = 0
        """Bytes of pieces that were sent again."""
        self._lost: dict[Priority, deque[Piece]] = {rank: deque() for rank in Priority}
        self._begun: dict[Priority, _OutgoingMessage] = {}
        """The message of each class whose pieces are not all sent for the first time."""

    def __len__(self) -> int:
        return len(self._queue) + len(self._messages)

    @property
    def waiting(self) -> int:
        """Frames that have not begun."""
        return len(self._queue)

    @property
    def waiting_bytes(self) -> int:
        """Bytes of the frames that have not arrived."""
        return self._queue.queued_bytes + sum(message.missing for message in self._messages.values())

    @property
    def floor(self) -> int:
        """All messages before this number have arrived."""
        return next(iter(self._messages), self._next_number)

    def put(self, queued: QueuedFrame) -> list[QueuedFrame]:
        """Queue a frame, unless it is in the queue or in flight; returns the frames dropped for it."""
        identity = _identity(queued.frame)
        # the sender retransmits end to end while this link still repeats the first copy
        if identity in self._identities:
            return []
        self._identities.add(identity)
        gone = self._queue.put(queued.data, queued.frame, queued.since_ns)
        self._forget(gone)
        return gone

    def has(self, ranks: Sequence[Priority]) -> bool:
        """Whether pieces of these classes can be sent."""
        if any(self._lost[rank] or rank in self._begun for rank in ranks):
            return True
        return self._may_begin() and any(self._queue.has_class(rank) for rank in ranks)

    def take(
        self, ranks: Sequence[Priority], room: int, now_ns: int
    ) -> tuple[Piece | None, QueuedFrame | None, list[QueuedFrame]]:
        """The next piece that fits, the frame that begins with it, and frames that were too old to begin.

        Lost pieces of a class go before new ones.
        """
        gone: list[QueuedFrame] = []
        for rank in ranks:
            lost = self._lost[rank]
            # it has arrived after it had counted as lost
            while lost and not self._is_missing(lost[0]):
                lost.popleft()
            if lost:
                if piece_bytes(lost[0]) > room:
                    return None, None, gone
                self.repeated_bytes += len(lost[0].data)
                return lost.popleft(), None, gone
            begun = self._begun.get(rank)
            if begun is not None:
                return self._cut(begun, room), None, gone
            if not self._may_begin():
                continue
            waiting, old = self._queue.peek_class(rank, now_ns)
            self._forget(old)
            gone += old
            if waiting is None:
                continue
            size = len(waiting.data)
            # a frame that fits a packet of its own is not split for the rest of this one
            if size + WHOLE_BYTES > room and (room < SPLIT_MIN or size + WHOLE_BYTES <= ROOM):
                return None, None, gone
            return self._begin(rank, room), waiting, gone
        return None, None, gone

    def _may_begin(self) -> bool:
        # the receiver refuses messages further from the first incomplete one
        return self._next_number - self.floor < SPAN_MAX - 1

    def _begin(self, rank: Priority, room: int) -> Piece | None:
        queued = self._queue.pop_class(rank)
        message = _OutgoingMessage(self._next_number, rank, queued, len(queued.data))
        self._next_number += 1
        self._messages[message.number] = message
        self._begun[rank] = message
        return self._cut(message, room)

    def _cut(self, message: _OutgoingMessage, room: int) -> Piece | None:
        data, offset = message.queued.data, message.next_offset
        size = len(data) - offset
        header = PIECE_BYTES if offset or size + WHOLE_BYTES > room else WHOLE_BYTES
        if size + header > room:
            if room < SPLIT_MIN:
                return None
            size = room - header
        message.next_offset = offset + size
        if message.next_offset == len(data):
            del self._begun[message.rank]
        return Piece(message.number, len(data), offset, data[offset : offset + size])

    def _is_missing(self, piece: Piece) -> bool:
        message = self._messages.get(piece.message)
        return message is not None and piece.offset not in message.arrived

    def has_command(self, pieces: tuple[Piece, ...]) -> bool:
        """Whether one of the pieces is of a command that has not arrived."""
        found = (self._messages.get(piece.message) for piece in pieces)
        return any(message is not None and message.rank in COMMANDS for message in found)

    def on_arrived(self, piece: Piece) -> None:
        """A piece was acknowledged."""
        message = self._messages.get(piece.message)
        if message is None or piece.offset in message.arrived:
            return
        message.arrived.add(piece.offset)
        message.missing -= len(piece.data)
        if not message.missing:
            self.arrived_frames += 1
            del self._messages[piece.message]
            self._identities.discard(_identity(message.queued.frame))

    def on_lost(self, piece: Piece) -> None:
        """A piece counts as lost."""
        message = self._messages.get(piece.message)
        if message is not None and piece.offset not in message.arrived:
            self._lost[message.rank].append(piece)

    def repeat(self, pieces: tuple[Piece, ...], copies: int) -> tuple[Piece, ...]:
        """Selects the pieces that have not arrived, which a probe repeats."""
        missing = tuple(piece for piece in pieces if self._is_missing(piece))
        self.repeated_bytes += copies * sum(len(piece.data) for piece in missing)
        return missing

    def clear(self) -> list[QueuedFrame]:
        """Removes and returns all frames that have not arrived, by priority."""
        begun = sorted(self._messages.values(), key=lambda message: message.rank)
        # begun messages go first; they were taken from the head of their class
        frames = [message.queued for message in begun] + self._queue.clear()
        self._messages.clear()
        self._begun.clear()
        self._identities.clear()
        for lost in self._lost.values():
            lost.clear()
        return frames

    def _forget(self, frames: list[QueuedFrame]) -> None:
        self._identities.difference_update(_identity(one.frame) for one in frames)


def _identity(frame: Frame) -> Identity:
    return frame.sender_hw, frame.sender_app, frame.data_id, frame.sequence, frame.kind
