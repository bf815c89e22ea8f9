"""Former values of one board for one subscriber: what could not be sent, kept within bytes and seconds."""

from bisect import bisect_right, insort
from collections.abc import Sequence
from operator import attrgetter
from typing import Final

from swarmd.tree.core.notification.condition import differs
from swarmd.tree.core.notification.feed_channel import BURST_NS, FeedChannel
from swarmware.model.resource import Resource
from swarmware.types.tree_exchange import TreeItem

_STAMP: Final = attrgetter("stamp_ns")
NEVER_NS: Final = -(1 << 62)
"""Before all stamps."""


class BoardHistory:
    """Keeps the values that an undisturbed link would have sent.

    A value is sent only after a newer one has arrived; of the values that may be sent, the newest goes first.
    """

    __slots__ = (
        "_arrived_ns", "_interval_ns", "_items", "_kept_data", "_kept_ns", "_sent_ns", "_size", "channel",
        "deadband", "dropped", "resource",
    )  # fmt: skip

    latest_only: Final = True
    """The values of a notification that failed return: newer ones may go before them."""
    pending_ns: Final = None
    """No newest value waits here."""

    def __init__(self, resource: Resource, deadband: float) -> None:
        self.resource = resource
        self.deadband = deadband
        self.channel = FeedChannel()
        self._interval_ns = 0
        self._items: list[TreeItem] = []
        """By stamp."""
        self._size = 0
        """Bytes of values in them."""
        self._kept_data: bytes | None = None
        self._kept_ns = NEVER_NS
        """Payload and instant of the value that was sent or kept last."""
        self._arrived_ns = NEVER_NS
        """Stamp up to which values are sent: a newer one has arrived. Without this bound they would travel
        beside the newest one, in an outage too short to be seen before it, and hold it up on a slow link."""
        self._sent_ns = NEVER_NS
        self.dropped = 0
        """Values that were dropped from the full buffer, or became too old in it."""

    @property
    def waiting(self) -> tuple[int, int]:
        """Number and bytes of the values that wait."""
        return len(self._items), self._size

    def set_channel(self, channel: FeedChannel, interval_ns: int) -> None:
        """Set the buffer, the rate and the minimum interval of the values."""
        self.channel, self._interval_ns = channel, interval_ns
        self._shorten()

    def on_sent(self, item: TreeItem) -> None:
        """A newest value was sent."""
        self._kept_data, self._kept_ns = item.data, max(self._kept_ns, item.stamp_ns)

    def on_arrived(self, item: TreeItem) -> None:
        """A newest value has arrived: older ones may follow."""
        self._arrived_ns = max(self._arrived_ns, item.stamp_ns)

    def on_settled(self) -> None:
        """The subscriber has the newest value: all others may follow."""
        if self._items:
            self._arrived_ns = max(self._arrived_ns, self._items[-1].stamp_ns)

    def on_failed(self) -> None:
        """A newest value did not arrive: the next one goes before all others again."""
        self._arrived_ns = NEVER_NS

    def on_superseded(self, item: TreeItem, next_ns: int) -> None:
        """A value that waited was replaced by one with the stamp `next_ns`.

        It is kept if it was the newest at an instant at which one was due: a rate holds here, too.
        """
        due_ns = max(self._kept_ns + self._interval_ns, item.stamp_ns)
        is_new = self._kept_data is None or differs(self._kept_data, item.data, self.deadband)
        # the buffer holds what the rate would have sent, not each written value
        if next_ns > due_ns and is_new and self.channel.limit_ns is not None:
            self._kept_data, self._kept_ns = item.data, due_ns
            self.keep(item)

    def keep(self, item: TreeItem) -> None:
        """Add a value that was not delivered."""
        # a value that failed may be older than values that came meanwhile
        insort(self._items, item, key=_STAMP)
        self._size += len(item.data)
        self._shorten()

    def _shorten(self) -> None:
        items, channel = self._items, self.channel
        # one value always stays, even if it alone is larger than the buffer
        while len(items) > channel.buffer_items or (self._size > channel.buffer_bytes and len(items) > 1):
            self._drop_first()
        if items:
            self._drop_before(items[-1].stamp_ns)

    def _drop_before(self, now_ns: int) -> None:
        age_ns = self.channel.buffer_ns
        while age_ns is not None and self._items and now_ns - self._items[0].stamp_ns > age_ns:
            self._drop_first()

    def _drop_first(self) -> None:
        self._size -= len(self._items.pop(0).data)
        self.dropped += 1

    def due_ns(self) -> int | None:
        """When the next values are due, or None if none waits or may be sent."""
        pace_ns = self.channel.catch_up_ns
        if pace_ns is None or not self._items or self._items[0].stamp_ns > self._arrived_ns:
            return None
        return self._sent_ns + pace_ns

    def take(self, now_ns: int, limit: int, room: int) -> list[TreeItem]:
        """Take values to be sent, at most `limit` and about `room` bytes: the newest first."""
        self._drop_before(now_ns)
        if pace_ns := self.channel.catch_up_ns:
            # not more than the pace allows for the elapsed time, so that a pause makes no burst
            limit = min(limit, max(1, min(now_ns - self._sent_ns, BURST_NS) // pace_ns))
        self._sent_ns = now_ns
        taken: list[TreeItem] = []
        # from the end: the newest former value is worth more than an old one
        sendable = bisect_right(self._items, self._arrived_ns, key=_STAMP)
        while sendable and len(taken) < limit and (room > 0 or not taken):
            sendable -= 1
            taken.append(self._items.pop(sendable))
            room -= len(taken[-1].data)
        self._size -= sum(len(item.data) for item in taken)
        return taken

    def on_acknowledged(self, items: Sequence[TreeItem], now_ns: int) -> None:
        """Values that were taken have been acknowledged."""

    def requeue(self, items: list[TreeItem]) -> None:
        """Return values that were not delivered."""
        for item in items:
            self.keep(item)
