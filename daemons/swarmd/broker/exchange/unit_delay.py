"""A simulated delay of the frames between the computers of a platform, for the lab."""

import asyncio
import random
from collections import deque
from collections.abc import Callable


class UnitDelays:
    """Holds the frames of each sender back for times of its own, so that they stay in order."""

    def __init__(self, shortest_ms: float, longest_ms: float) -> None:
        self._limits_ms = (shortest_ms, longest_ms)
        self._senders: dict[int, UnitDelay] = {}

    def hold(self, sender_hw: int, release: Callable[[], None]) -> None:
        """Call `release` when the delay of this frame is over."""
        if sender_hw not in self._senders:
            self._senders[sender_hw] = UnitDelay(*self._limits_ms)
        self._senders[sender_hw].hold(release)

    def close(self) -> None:
        """Drop the frames that are held back."""
        for delay in self._senders.values():
            delay.close()


class UnitDelay:
    """Holds each frame back for a random time between two limits; their order stays."""

    def __init__(self, shortest_ms: float, longest_ms: float) -> None:
        self._limits_s = (shortest_ms / 1e3, longest_ms / 1e3)
        self._random = random.Random()
        self._due_s = 0.0
        self._held: deque[Callable[[], None]] = deque()
        self._timers: deque[asyncio.TimerHandle] = deque()

    def hold(self, release: Callable[[], None]) -> None:
        """Call `release` when the delay of this frame is over."""
        loop = asyncio.get_running_loop()
        self._due_s = max(self._due_s, loop.time() + self._random.uniform(*self._limits_s))
        self._held.append(release)
        self._timers.append(loop.call_at(self._due_s, self._release))

    def _release(self) -> None:
        # timers of the same millisecond end in any order
        self._timers.popleft()
        self._held.popleft()()

    def close(self) -> None:
        """Drop the frames that are held back."""
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()
        self._held.clear()
