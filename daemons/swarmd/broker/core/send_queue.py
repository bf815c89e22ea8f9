"""Frames that wait for a neighbour: strict priorities, bounded in number, bytes and age."""

from collections import deque
from enum import IntEnum
from typing import Final

import msgspec

from swarmware.frame import Flag, Frame, Kind

FRAMES_MAX: Final = 2048
BYTES_MAX: Final = 8 * 1024 * 1024
AGE_MAX_NS: Final = 5_000_000_000
"""What waited longer has been given up by its sender, or was sent again."""


class Priority(IntEnum):
    """Classes of frames, the first is served first."""

    URGENT = 0
    """What its sender marked urgent, and the answers to it."""
    CONTROL = 1
    """Commands and requests, and what answers them."""
    NOTIFY = 2
    STREAM = 3
    BULK = 4
    """Files."""


class ConnectionClass(IntEnum):
    """Connections to a neighbour; each takes classes of its own."""

    CONTROL = 0
    """Urgent frames and commands: what a connection has taken already cannot be overtaken on it."""
    DATA = 1
    """All else."""


_BY_KIND: Final = {
    Kind.STREAM: Priority.STREAM,
    Kind.NOTIFY: Priority.NOTIFY,
    Kind.EVENT: Priority.NOTIFY,
    Kind.BOARD: Priority.STREAM,
    Kind.FILE: Priority.BULK,
}


def priority(frame: Frame) -> Priority:
    """The class that a frame belongs to."""
    if frame.flags & Flag.URGENT:
        return Priority.URGENT
    return _BY_KIND.get(frame.kind, Priority.CONTROL)


def connection_class(frame: Frame) -> ConnectionClass:
    """The connection that a frame takes."""
    return ConnectionClass.CONTROL if priority(frame) <= Priority.CONTROL else ConnectionClass.DATA


class QueuedFrame(msgspec.Struct, frozen=True, gc=False):
    """A frame in the queue."""

    data: bytes
    frame: Frame
    since_ns: int


class SendQueue:
    """What waits for one neighbour, for all connections to it."""

    def __init__(self) -> None:
        self._classes: tuple[deque[QueuedFrame], ...] = tuple(deque() for _ in Priority)
        first_data = Priority.CONTROL + 1
        self._by_connection = (self._classes[:first_data], self._classes[first_data:])
        self._frames = 0
        self._bytes = 0

    def __len__(self) -> int:
        return self._frames

    def has(self, connection_class: ConnectionClass) -> bool:
        """Whether something waits for this connection."""
        return any(self._by_connection[connection_class])

    def put(self, data: bytes, frame: Frame, now_ns: int) -> list[QueuedFrame]:
        """A frame; what had to go for it, the oldest of the least important class first, or itself."""
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

    def peek(
        self, connection_class: ConnectionClass, now_ns: int
    ) -> tuple[QueuedFrame | None, list[QueuedFrame]]:
        """The next frame of a connection, and those that became too old on the way to it."""
        old: list[QueuedFrame] = []
        for queue in self._by_connection[connection_class]:
            while queue:
                if now_ns - queue[0].since_ns <= AGE_MAX_NS:
                    return queue[0], old
                old.append(self._take(queue))
        return None, old

    def pop(self, connection_class: ConnectionClass) -> QueuedFrame:
        """Takes the frame that `peek` showed.

        Raises: IndexError when nothing waits.
        """
        for queue in self._by_connection[connection_class]:
            if queue:
                return self._take(queue)
        raise IndexError("nothing waits")

    def clear(self) -> list[QueuedFrame]:
        """Takes everything, the most important first."""
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
