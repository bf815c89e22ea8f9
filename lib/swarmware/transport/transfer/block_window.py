"""Order of the blocks of a file that are requested or sent, with a window of blocks in flight. Sans-io."""

from collections import deque
from collections.abc import Iterable
from typing import Final

from swarmware.runtime.backoff import pause_after
from swarmware.transport.retransmission.flight import Flight, Sent
from swarmware.transport.retransmission.policy import RetransmissionPolicy

BLOCKS: Final = RetransmissionPolicy(
    window_first=2,
    window_min=1,
    window_max=16,  # 256 KiB, which fill 50 Mbit/s at 40 ms
    window_growth=1 / 2,
    keeps_backoff=True,  # a shorter time would send whole blocks of a slow link twice
)
"""The window counts blocks; the link controls its own rate."""
TIMEOUTS_S: Final = (6.0, 12.0, 24.0, 48.0)
"""Time for one block at first and after each failure, retransmissions of the link included; each attempt
sends the whole block."""


class BlockWindow(Flight[int, Sent]):
    """Blocks that have not been sent, and the blocks in flight by number."""

    def __init__(self, ranges: Iterable[tuple[int, int]], now_ns: int) -> None:
        """`ranges`: first and last number of the missing blocks."""
        super().__init__(BLOCKS)
        self.arrived_ns = now_ns
        self._waiting = deque(number for first, last in ranges for number in range(first, last + 1))

    @property
    def is_done(self) -> bool:
        """Whether no block waits or is in flight."""
        return not self._waiting and not self

    @property
    def timeout_s(self) -> float:
        """Time after which a block that is sent or requested now has failed."""
        return pause_after(self.failures + 1, TIMEOUTS_S)

    def take(self, now_ns: int) -> int | None:
        """The next block, first those that failed, or None with a full window or without a waiting block."""
        for number in self.repeatable():
            self.resend(number, now_ns)
            return number
        if not self._waiting or not self.has_room():
            return None
        number = self._waiting.popleft()
        self.add(number, Sent(sent_ns=now_ns))
        return number
