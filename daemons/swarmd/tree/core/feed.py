"""One resource on its way to one subscriber: what is to be sent, and from when on."""

from collections import deque
from typing import Final

from swarmd.tree.core.condition import INTERVAL_MAX_S, differs
from swarmware.resource import Kind, Resource
from swarmware.types.tree import Rule, TreeItem

QUEUE_LIMIT: Final = 4096
"""Items that wait for one subscriber; what an outage of minutes makes, not of hours."""
QUEUE_BYTES: Final = 1024 * 1024
"""Of values in them; one item always has room."""
BOARDLIKE: Final = frozenset({Kind.BOARD, Kind.SETTING})
"""Kinds of which only the newest value counts."""


class Feed:
    """A board: the newest value when it is worth it. Events and streams: each one, in order."""

    __slots__ = (
        "_interval_ns", "_limit_ns", "_newest", "_pending", "_queue", "_repeat_ns", "_sent", "_sent_ns",
        "_size", "_under_way", "boardlike", "dropped", "resource", "rule",
    )  # fmt: skip

    def __init__(self, resource: Resource, rule: Rule, default_interval_ns: int) -> None:
        self.resource = resource
        self.rule = rule
        self.boardlike = resource.kind in BOARDLIKE
        wanted_ns = _ns(rule.min_interval_s)
        if not wanted_ns and self.boardlike:
            wanted_ns = max(default_interval_ns, round(1e9 / resource.rate_hz) if resource.rate_hz > 0 else 0)
        self._interval_ns = wanted_ns
        self._repeat_ns = _ns(rule.max_interval_s) if self.boardlike else 0
        self._limit_ns: int | None = 0
        """Between two values, whatever the subscriber asks for; None: nothing is sent."""
        self._newest: TreeItem | None = None
        self._pending: TreeItem | None = None
        self._queue: deque[TreeItem] = deque()
        self._sent: bytes | None = None
        """Payload that the subscriber has, or that is on its way."""
        self._sent_ns = -(1 << 62)
        self._size = 0
        """Bytes in the queue."""
        self._under_way = False
        """A board: the next value waits for the acknowledgement of this one, and is then the newest."""
        self.dropped = 0
        """Items for which the queue had no room."""

    def limit(self, max_hz: float | None) -> None:
        """An operator's limit; None: none. Events and streams have none: each item of them is promised."""
        if self.boardlike:
            self._limit_ns = 0 if max_hz is None else None if max_hz <= 0 else round(1e9 / max_hz)

    def offer(self, item: TreeItem) -> None:
        """A value of the resource."""
        if not self.boardlike:
            self._push(item)
            return
        self._newest = item
        changed = self._sent is None or differs(self._sent, item.data, self.rule.deadband)
        # a value that came back to what was sent last is no news
        self._pending = item if changed else None

    def _push(self, item: TreeItem) -> None:
        self._queue.append(item)
        self._size += len(item.data)
        self._shorten()

    def _shorten(self) -> None:
        queue = self._queue
        while len(queue) > QUEUE_LIMIT or (self._size > QUEUE_BYTES and len(queue) > 1):
            self._size -= len(queue.popleft().data)
            self.dropped += 1

    def reset(self) -> None:
        """The subscriber has forgotten what it was sent."""
        self._under_way = False
        self._sent = None
        self._sent_ns = -(1 << 62)
        self._pending = self._newest

    def due_ns(self) -> int | None:
        """From when on there is something to send."""
        if self._under_way or self._limit_ns is None:
            return None
        if self._pending is not None or self._queue:
            return self._sent_ns + max(self._interval_ns, self._limit_ns)
        if self._repeat_ns and self._newest is not None:
            return self._sent_ns + max(self._repeat_ns, self._limit_ns)
        return None

    def take(self, now_ns: int, limit: int, room: int) -> list[TreeItem]:
        """What is to be sent now, at most so many items and bytes, but one; it counts as sent."""
        if self.boardlike:
            item = self._pending or self._newest
            if item is None:
                return []
            self._pending = None
            self._under_way = True
            self._sent, self._sent_ns = item.data, now_ns
            return [item]
        self._sent_ns = now_ns
        taken: list[TreeItem] = []
        while self._queue and len(taken) < limit and (room > 0 or not taken):
            taken.append(self._queue.popleft())
            room -= len(taken[-1].data)
        self._size -= sum(len(item.data) for item in taken)
        return taken

    def arrived(self) -> None:
        """What was taken last is there."""
        self._under_way = False

    def put_back(self, items: list[TreeItem]) -> None:
        """They did not arrive."""
        self._under_way = False
        if self.boardlike:
            self._sent = None
            self._pending = self._newest
            return
        self._queue.extendleft(reversed(items))
        self._size += sum(len(item.data) for item in items)
        self._shorten()


def _ns(interval_s: float) -> int:
    return round(min(interval_s, INTERVAL_MAX_S) * 1e9)
