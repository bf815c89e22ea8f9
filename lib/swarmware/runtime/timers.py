"""Deadlines by key, with the next one first."""

import heapq
from collections.abc import Hashable
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)


class Timers(Generic[Key]):
    """At most one deadline per key; setting another replaces it."""

    def __init__(self) -> None:
        self._due: dict[Key, int] = {}
        self._heap: list[tuple[int, int, Key]] = []
        self._count = 0

    def set(self, key: Key, when_ns: int) -> None:
        """Set the key's deadline."""
        if self._due.get(key) != when_ns:
            self._due[key] = when_ns
            self._count += 1  # keys need not have an order
            heapq.heappush(self._heap, (when_ns, self._count, key))

    def drop(self, key: Key) -> None:
        """Remove the key's deadline."""
        self._due.pop(key, None)

    def next_ns(self) -> int | None:
        """The earliest deadline of all keys."""
        heap = self._heap
        while heap:
            when_ns, _, key = heap[0]
            # replaced deadlines stay in the heap until they are the first: removal would search the heap
            if self._due.get(key) == when_ns:
                return when_ns
            heapq.heappop(heap)
        return None

    def pop(self, now_ns: int) -> Key | None:
        """Remove and return a key that is due, or None without one."""
        when_ns = self.next_ns()
        if when_ns is None or when_ns > now_ns:
            return None
        key = heapq.heappop(self._heap)[2]
        del self._due[key]
        return key
