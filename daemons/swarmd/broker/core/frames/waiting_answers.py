"""Answers whose receiver has no route at the moment; they wait, because no sender repeats them."""

from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec

from swarmware.model.frame import Frame, FrameKind
from swarmware.transport.delivery.answer import ANSWERS

WAIT_NS: Final = 2_000_000_000
"""At 30 % loss a route that was lost is back after a second; later the question has been repeated."""
FRAMES_MAX: Final = 256
BYTES_MAX: Final = 4 * 1024 * 1024


class WaitingAnswer(msgspec.Struct, frozen=True, gc=False):
    """An answer that waits for a route."""

    frame: Frame
    relayed: bool
    """Another node made the answer, so nothing in it may change."""
    since_ns: int


class WaitingAnswers:
    """Answers without a route, the oldest first; bounded in number, bytes and time.

    A message or request without a route is refused instead: the sender gets the reason and repeats it.
    """

    def __init__(self) -> None:
        self._waiting: deque[WaitingAnswer] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def hold(self, frame: Frame, relayed: bool, now_ns: int) -> bool:
        """Keeps an answer until it has a route; returns False for any other frame."""
        if frame.kind not in ANSWERS and frame.kind is not FrameKind.HELLO:
            return False
        self._waiting.append(WaitingAnswer(frame, relayed, now_ns))
        self._bytes += len(frame.payload)
        while len(self._waiting) > FRAMES_MAX or self._bytes > BYTES_MAX:
            self._drop_first()
        return True

    def take(self, has_route: Callable[[int], bool], now_ns: int) -> list[WaitingAnswer]:
        """Removes and returns those that have a route now, and forgets those that are too old."""
        while self._waiting and now_ns - self._waiting[0].since_ns > WAIT_NS:
            self._drop_first()
        ready = [one for one in self._waiting if has_route(one.frame.receiver_hw)]
        if ready:
            self._waiting = deque(one for one in self._waiting if not has_route(one.frame.receiver_hw))
            self._bytes -= sum(len(one.frame.payload) for one in ready)
        return ready

    def _drop_first(self) -> None:
        self._bytes -= len(self._waiting.popleft().frame.payload)
