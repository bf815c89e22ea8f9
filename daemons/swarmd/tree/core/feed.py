"""One resource on its way to one subscriber: what is to be sent, and from when on."""

from collections import deque
from typing import Final

from swarmd.tree.core.condition import INTERVAL_MAX_S, differs
from swarmware.resource import Kind, Resource
from swarmware.types.tree import Rule, TreeItem

QUEUE_LIMIT: Final = 512
"""Events that wait for one subscriber; what an outage of minutes makes, not of hours."""
BOARDLIKE: Final = frozenset({Kind.BOARD, Kind.SETTING})
"""Kinds of which only the newest value counts."""


class Feed:
    """A board: the newest value when it is worth it. Events and streams: each one, in order."""

    __slots__ = (
        "_interval_ns", "_newest", "_pending", "_queue", "_repeat_ns", "_sent", "_sent_ns",
        "boardlike", "dropped", "resource", "rule",
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
        self._newest: TreeItem | None = None
        self._pending: TreeItem | None = None
        self._queue: deque[TreeItem] = deque()
        self._sent: bytes | None = None
        """Payload that the subscriber has, or that is on its way."""
        self._sent_ns = -(1 << 62)
        self.dropped = 0
        """Events for which the queue had no room."""

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
        if len(self._queue) >= QUEUE_LIMIT:
            self._queue.popleft()
            self.dropped += 1
        self._queue.append(item)

    def reset(self) -> None:
        """The subscriber has forgotten what it was sent."""
        self._sent = None
        self._sent_ns = -(1 << 62)
        self._pending = self._newest

    def due_ns(self) -> int | None:
        """From when on there is something to send."""
        if self._pending is not None or self._queue:
            return self._sent_ns + self._interval_ns
        if self._repeat_ns and self._newest is not None:
            return self._sent_ns + self._repeat_ns
        return None

    def take(self, now_ns: int, limit: int) -> list[TreeItem]:
        """What is to be sent now, at most so many; it counts as sent."""
        if self.boardlike:
            item = self._pending or self._newest
            if item is None:
                return []
            self._pending = None
            self._sent, self._sent_ns = item.data, now_ns
            return [item]
        self._sent_ns = now_ns
        return [self._queue.popleft() for _ in range(min(limit, len(self._queue)))]

    def put_back(self, items: list[TreeItem]) -> None:
        """They did not arrive."""
        if self.boardlike:
            self._sent = None
            self._pending = self._newest
            return
        room = QUEUE_LIMIT - len(self._queue)
        self.dropped += max(0, len(items) - room)
        # the oldest go first, as in `offer`
        self._queue.extendleft(reversed(items[len(items) - room :] if len(items) > room else items))


def _ns(interval_s: float) -> int:
    return round(min(interval_s, INTERVAL_MAX_S) * 1e9)
