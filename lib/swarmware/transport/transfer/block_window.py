"""Order of the blocks of a file that are requested or sent, with a window of blocks in flight. Sans-io."""

from collections import deque
from collections.abc import Iterable
from typing import Final

from swarmware.runtime.backoff import pause_after

FIRST: Final = 2.0
GROWTH: Final = 0.5
"""Growth of the window with each arrived block; the link controls its own rate."""
LIMIT: Final = 16.0
"""Maximum blocks in flight: 256 KiB, which fill 50 Mbit/s at 40 ms."""

TIMEOUT_S: Final = 6.0
"""Time for one block at first, retransmissions included."""
TIMEOUTS_S: Final = (12.0, 24.0, 48.0)
"""Time for one block after the first, second, … failure; each attempt sends the whole block."""


class BlockWindow:
    """Waiting blocks, and a window of blocks in flight, which answers widen and failures halve."""

    def __init__(self, ranges: Iterable[tuple[int, int]]) -> None:
        """`ranges`: first and last number of the missing blocks."""
        self._waiting: deque[int] = deque()
        for first, last in ranges:
            self._waiting.extend(range(first, last + 1))
        self._under_way: set[int] = set()
        self._size = FIRST
        self._failures = 0
        self.timeout_s = TIMEOUT_S
        """Time after which a block that is sent or requested now has failed."""

    @property
    def is_done(self) -> bool:
        """Whether no block waits or is in flight."""
        return not self._waiting and not self._under_way

    def take(self) -> int | None:
        """The next block, or None with a full window or without a waiting block."""
        if not self._waiting or len(self._under_way) >= int(self._size):
            return None
        number = self._waiting.popleft()
        self._under_way.add(number)
        return number

    def on_done(self, number: int) -> None:
        """A block has arrived."""
        self._under_way.discard(number)
        self._size = min(self._size + GROWTH, LIMIT)

    def on_failed(self, number: int) -> None:
        """Put a block without an answer first in the queue."""
        if number in self._under_way:
            self._under_way.remove(number)
            self._waiting.appendleft(number)
            self._size = max(self._size / 2, 1.0)
            self._failures += 1
            self.timeout_s = pause_after(self._failures, TIMEOUTS_S)
