"""The shared air: transmit queues of the nodes, and which of them transmits when."""

from collections import deque
from collections.abc import Collection

import msgspec


class WaitingFrame(msgspec.Struct, frozen=True, gc=False):
    """A frame in the transmit queue of its sender."""

    sender: int
    data: bytes
    since_ns: int
    """Instant at which the sender gave it to the radio."""


class Medium:
    """Bounded transmit queues, of which those in range of each other take turns; the oldest frame is next."""

    def __init__(self, nodes: int, queue_bytes: int) -> None:
        self._limit = queue_bytes
        self._queues: list[deque[WaitingFrame]] = [deque() for _ in range(nodes)]
        self._bytes = [0] * nodes
        self._free_ns = [0] * nodes
        """Instant from which each node finds the air free."""
        self._waiting: set[int] = set()

    def queued_bytes(self, sender: int) -> int:
        """Bytes in the transmit queue of a node."""
        return self._bytes[sender]

    def add(self, frame: WaitingFrame) -> bool:
        """Queues a frame; False when the queue is full."""
        if self._bytes[frame.sender] + len(frame.data) > self._limit:
            return False
        self._queues[frame.sender].append(frame)
        self._bytes[frame.sender] += len(frame.data)
        self._waiting.add(frame.sender)
        return True

    def next_start_ns(self) -> int | None:
        """Instant at which the next transmission starts, or None with an empty queue."""
        return min(map(self._start_ns, self._waiting), default=None)

    def take(self, now_ns: int) -> tuple[WaitingFrame, int] | None:
        """The next frame whose transmission has started and the instant of its start, or None."""
        ready = [
            (self._start_ns(sender), self._queues[sender][0].since_ns, sender) for sender in self._waiting
        ]
        # the oldest frame among those that may start: with equal starts `since_ns` decides
        if not ready or min(ready)[0] > now_ns:
            return None
        start_ns, _, sender = min(ready)
        frame = self._queues[sender].popleft()
        self._bytes[sender] -= len(frame.data)
        if not self._queues[sender]:
            self._waiting.discard(sender)
        return frame, start_ns

    def occupy(self, nodes: Collection[int], until_ns: int) -> None:
        """The air is busy at these nodes until then."""
        for node in nodes:
            self._free_ns[node] = max(self._free_ns[node], until_ns)

    def _start_ns(self, sender: int) -> int:
        return max(self._free_ns[sender], self._queues[sender][0].since_ns)
