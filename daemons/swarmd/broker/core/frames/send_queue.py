"""Queue of frames for a neighbour: strict priorities, bounded in number, bytes and age."""

from collections import deque
from enum import IntEnum
from typing import Final

import msgspec

from swarmware.model.frame import Frame, FrameKind

FRAMES_MAX: Final = 2048
BYTES_MAX: Final = 8 * 1024 * 1024
AGE_MAX_NS: Final = 5_000_000_000
"""Maximum time in the queue: later the sender has given up or retransmitted."""


class Priority(IntEnum):
    """Priority classes, in the order of service."""

    URGENT = 0
    """Frames marked urgent by the sender, and their replies."""
    CONTROL = 1
    """Commands, requests and their replies."""
    NOTIFY = 2
    STREAM = 3
    BOARD = 4
    """Boards that are sent by notification."""
    BULK = 5
    """Files, and parts of large values."""


class ConnectionClass(IntEnum):
    """The two connections to a neighbour, each for its priority classes."""

    CONTROL = 0
    """Urgent frames and commands: a frame cannot overtake another one within a connection."""
    DATA = 1
    """All other frames."""


_BY_KIND: Final = {
    FrameKind.STREAM: Priority.STREAM,
    FrameKind.NOTIFY: Priority.NOTIFY,
    FrameKind.EVENT: Priority.NOTIFY,
    FrameKind.BOARD: Priority.BOARD,
    FrameKind.FILE: Priority.BULK,
}
"""All others are commands, requests and answers: `CONTROL`."""


def priority(frame: Frame) -> Priority:
    """Priority class of a frame."""
    if frame.is_urgent:
        return Priority.URGENT
    if frame.is_bulk:
        return Priority.BULK
    return _BY_KIND.get(frame.kind, Priority.CONTROL)


def connection_class(frame: Frame) -> ConnectionClass:
    """Connection of a frame."""
    if priority(frame) > Priority.CONTROL:
        return ConnectionClass.DATA
    return ConnectionClass.CONTROL


class QueuedFrame(msgspec.Struct, frozen=True, gc=False):
    """A queued frame, encoded and decoded."""

    data: bytes
    frame: Frame
    since_ns: int


class SendQueue:
    """Queued frames of one neighbour, for both connections."""

    def __init__(self) -> None:
        self._classes: tuple[deque[QueuedFrame], ...] = tuple(deque() for _ in Priority)
        first_data = Priority.CONTROL + 1
        self._by_connection = (self._classes[:first_data], self._classes[first_data:])
        self._frames = 0
        self._bytes = 0

    def __len__(self) -> int:
        return self._frames

    @property
    def queued_bytes(self) -> int:
        """Bytes of the queued frames."""
        return self._bytes

    def has(self, connection_class: ConnectionClass) -> bool:
        """Whether frames are queued for a connection."""
        return any(self._by_connection[connection_class])

    def put(self, data: bytes, frame: Frame, now_ns: int) -> list[QueuedFrame]:
        """Queues a frame; returns the dropped ones, the oldest of the lowest priority first."""
        waiting = QueuedFrame(data, frame, now_ns)
        rank = priority(frame)
        self._classes[rank].append(waiting)
        self._frames += 1
        self._bytes += len(data)
        gone: list[QueuedFrame] = []
        while self._frames > FRAMES_MAX or self._bytes > BYTES_MAX:
            last = next(q for q in reversed(self._classes) if q)
            gone.append(self._take(last))
        return gone

    def has_class(self, rank: Priority) -> bool:
        """Whether frames of a priority class are queued."""
        return bool(self._classes[rank])

    def peek(
        self, connection_class: ConnectionClass, now_ns: int
    ) -> tuple[QueuedFrame | None, list[QueuedFrame]]:
        """The next frame of a connection, and the expired frames before it, which are removed."""
        return self._first(self._by_connection[connection_class], now_ns)

    def peek_class(self, rank: Priority, now_ns: int) -> tuple[QueuedFrame | None, list[QueuedFrame]]:
        """The next frame of a priority class, and the expired frames before it, which are removed."""
        return self._first((self._classes[rank],), now_ns)

    def pop_class(self, rank: Priority) -> QueuedFrame:
        """Removes and returns the frame that `peek_class` returned.

        Raises: IndexError when the class is empty.
        """
        return self._take(self._classes[rank])

    def _first(
        self, queues: tuple[deque[QueuedFrame], ...], now_ns: int
    ) -> tuple[QueuedFrame | None, list[QueuedFrame]]:
        old: list[QueuedFrame] = []
        for queue in queues:
            while queue:
                if now_ns - queue[0].since_ns <= AGE_MAX_NS:
                    return queue[0], old
                old.append(self._take(queue))
        return None, old

    def pop(self, connection_class: ConnectionClass) -> QueuedFrame:
        """Removes and returns the frame that `peek` returned.

        Raises: IndexError when the queue is empty.
        """
        for queue in self._by_connection[connection_class]:
            if queue:
                return self._take(queue)
        raise IndexError("the queue is empty")

    def clear(self) -> list[QueuedFrame]:
        """Removes and returns all frames by priority."""
        out = [waiting for queue in self._classes for waiting in queue]
        for queue in self._classes:
            queue.clear()
        self._frames = self._bytes = 0
        return out

    def _take(self, queue: deque[QueuedFrame]) -> QueuedFrame:
        waiting = queue.popleft()
        self._frames -= 1
        self._bytes -= len(waiting.data)
        return waiting
