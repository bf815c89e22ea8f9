"""Values of one resource for one subscriber: what is sent, and when."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from swarmd.tree.core.notification.board_history import BoardHistory
from swarmd.tree.core.notification.condition import INTERVAL_MAX_S, differs
from swarmd.tree.core.notification.feed_channel import BURST_NS, FeedChannel
from swarmd.tree.core.notification.link_rate import LinkRate
from swarmware.model.resource import Kind, Resource
from swarmware.types.channel import ChannelSettings
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import TreeItem

IMAGE: Final = "Image"
"""Type of the items that may go as video instead."""
LATEST_ONLY: Final = frozenset({Kind.BOARD, Kind.SETTING})
"""Kinds of which only the newest value is sent."""
RECENT_NS: Final = 10_000_000_000
"""Time for which it is shown that the link was the limit of a board."""


class Feed:
    """Sends of a board the newest value if it differs enough, of events and streams each item in order.

    With a buffer, former values of a board follow in `history`.
    """

    __slots__ = (
        "_admit_ns",
        "_channel",
        "_each",
        "_in_flight",
        "_interval_ns",
        "_limit_ns",
        "_link_rate",
        "_may_keep",
        "_newest",
        "_outpaced_ns",
        "_own_interval_ns",
        "_pending",
        "_queue",
        "_repeat_ns",
        "_sent",
        "_sent_ns",
        "_size",
        "_spacing_ns",
        "dropped",
        "held_back",
        "history",
        "latest_only",
        "resource",
        "rule",
    )  # fmt: skip

    def __init__(
        self, resource: Resource, rule: Rule, default_interval_ns: int, *, over_wire: bool = False
    ) -> None:
        """`over_wire`: the subscriber is another computer of this platform: it gets equal values, too, as its
        readers judge a value by its age."""
        self.resource = resource
        self.rule = rule
        self.latest_only = resource.kind in LATEST_ONLY
        wanted_ns = _ns(rule.min_interval_s)
        if not wanted_ns and self.latest_only:
            # a wire between computers of one platform has room for every value
            wanted_ns = max(0 if over_wire else default_interval_ns, half_period_ns(resource))
        self._own_interval_ns = wanted_ns
        self._interval_ns = wanted_ns
        """Minimum interval by rule or resource, or 0 while a rule of channels sets the rate."""
        # an event or item that is repeated would count as a second one
        self._repeat_ns = _ns(rule.max_interval_s) if self.latest_only else 0
        self._each = over_wire and rule.deadband <= 0
        """Whether a value that equals the one sent last is sent, too."""
        self._may_keep = resource.kind is Kind.BOARD and not over_wire
        self.history: BoardHistory | None = None
        """Board with a buffered channel: values that could not be sent."""
        self._limit_ns: int | None = 0
        """Minimum interval set by an operator, or None if nothing is sent."""
        self._newest: TreeItem | None = None
        self._pending: TreeItem | None = None
        self._queue: deque[TreeItem] = deque()
        self._sent: bytes | None = None
        """Payload that was sent last."""
        self._sent_ns = -(1 << 62)
        self._size = 0
        """Bytes of values in the queue."""
        self._in_flight: TreeItem | None = None
        """Board: the unacknowledged value, for which the next one waits."""
        self.dropped = 0
        """Items that were dropped from the full queue, or became too old in it."""
        self.held_back = 0
        """Items of a stream that a limit of its rate left out; values of a board that a newer one replaced
        while the link had not acknowledged the one before."""
        self._outpaced_ns = -(1 << 62)
        """Board: when a newer value last replaced a value that waited for the link."""
        self._spacing_ns = 0
        """Board: mean time between two values that were sent."""
        self._channel = FeedChannel()
        self._admit_ns: int | None = None
        """Limited stream: stamp from which the next item is sent, or None to begin with the next item."""
        self._link_rate: LinkRate | None = None
        """Stream with an adaptive channel: the rate that follows its link."""

    @property
    def channel(self) -> FeedChannel:
        """How its values travel."""
        return self._channel

    @property
    def waiting(self) -> tuple[int, int]:
        """Number and bytes of the items that wait."""
        count, size = len(self._queue), self._size
        if self.history is not None:
            count, size = self.history.waiting
        if self._pending is not None:
            count, size = count + 1, size + len(self._pending.data)
        return count, size

    @property
    def lost(self) -> int:
        """Number of dropped items, including former values of the history."""
        return self.dropped if self.history is None else self.dropped + self.history.dropped

    @property
    def link_rate(self) -> LinkRate | None:
        """The rate of a stream that follows its link."""
        return self._link_rate

    def is_outpaced(self, now_ns: int) -> bool:
        """Whether a board is written faster than the link acknowledges it."""
        return 0 <= now_ns - self._outpaced_ns < RECENT_NS

    def pace(self, now_ns: int) -> tuple[float | None, str]:
        """The limit of its rate in Hz, or None if unlimited, and the reason."""
        if self._link_rate is not None:
            return self._link_rate.rate_hz, self._link_rate.reason
        if self.latest_only and self.is_outpaced(now_ns):
            return 1e9 / max(self._spacing_ns, 1), "each value waits until the one before is acknowledged"
        limit_ns = self._channel.limit_ns
        if limit_ns is None:
            return 0.0, "set"
        return (1e9 / limit_ns, "set") if limit_ns else (None, "")

    @property
    def pending_ns(self) -> int | None:
        """Board: stamp of the value that waits, or None if no value waits."""
        return None if self._pending is None else self._pending.stamp_ns

    def set_channel(self, settings: ChannelSettings) -> None:
        """Set rate, buffer, compression and priority, as operators and the file set them."""
        may_be_video = self.resource.kind is Kind.STREAM and self.resource.type == IMAGE
        channel = FeedChannel.of(settings, may_be_video=may_be_video)
        # rules are applied again at each change of the structure, mostly without an effect
        if channel == self._channel:
            return
        is_limited = channel.limit_ns != self._channel.limit_ns
        self._channel = channel
        self._interval_ns = 0 if channel.is_rate_set else self._own_interval_ns
        if is_limited:
            self._admit_ns = None
            self._thin()
        self._follow_link(channel.is_adaptive and self.resource.kind is Kind.STREAM)
        # a stream is thinned when items arrive, so sending may catch up; a board is limited here
        self._limit_ns = channel.catch_up_ns if self.resource.kind is Kind.STREAM else channel.limit_ns
        self._shorten()
        if self._may_keep:
            self._set_history(channel)

    def _follow_link(self, is_adaptive: bool) -> None:
        if is_adaptive == (self._link_rate is not None):
            return
        self._link_rate = LinkRate() if is_adaptive else None
        if is_adaptive and len(self._queue) > 1:
            # what waits would be sent first, and is the older the slower the link is
            self.held_back += len(self._queue) - 1
            self._queue = deque((self._queue[-1],))
            self._size = len(self._queue[-1].data)

    def _set_history(self, channel: FeedChannel) -> None:
        if not channel.is_buffered:
            # what was in the buffer is lost with it, and stays in the count
            self.dropped = self.lost + (0 if self.history is None else self.history.waiting[0])
            self.history = None
            return
        if self.history is None:
            self.history = BoardHistory(self.resource, self.rule.deadband)
        self.history.set_channel(channel, max(self._interval_ns, channel.limit_ns or 0))

    def offer(self, item: TreeItem) -> None:
        """Add a value of the resource."""
        if not self.latest_only:
            if self._admits(item.stamp_ns) and self._is_carried(item):
                self._push(item)
            else:
                self.held_back += 1
            return
        # before the newer value takes its place
        if self.history is not None and self._pending is not None:
            self.history.on_superseded(self._pending, item.stamp_ns)
        if self._pending is not None and self._in_flight is not None:
            self._on_replaced(item.stamp_ns)
        self._newest = item
        changed = self._sent is None or self._each or differs(self._sent, item.data, self.rule.deadband)
        # else a value that is equal to the last sent one again is not sent
        self._pending = item if changed else None
        self._settle_history()

    def _is_carried(self, item: TreeItem) -> bool:
        return self._link_rate is None or self._link_rate.admits(item, self._waiting_ns)

    @property
    def _waiting_ns(self) -> int | None:
        return self._queue[0].stamp_ns if self._queue else None

    def _on_replaced(self, now_ns: int) -> None:
        """A value that waits is replaced; it was due if its rate allowed it and only the link did not."""
        if self._limit_ns is not None and now_ns >= self._sent_ns + max(self._interval_ns, self._limit_ns):
            self.held_back += 1
            self._outpaced_ns = now_ns

    def _push(self, item: TreeItem) -> None:
        self._queue.append(item)
        self._size += len(item.data)
        self._shorten()

    def _thin(self) -> None:
        """What waits obeys a new limit as well: else it holds only when that has been sent."""
        kept = deque(item for item in self._queue if self._admits(item.stamp_ns))
        self.held_back += len(self._queue) - len(kept)
        self._queue, self._size = kept, sum(len(item.data) for item in kept)

    def _admits(self, stamp_ns: int) -> bool:
        """Whether an item of a stream with this stamp is sent: of a limited one, items at equal distances."""
        period_ns = self._channel.limit_ns
        if self.resource.kind is not Kind.STREAM or period_ns == 0:
            return True
        if period_ns is None:
            return False
        due_ns = self._admit_ns
        if due_ns is not None and due_ns - period_ns <= stamp_ns < due_ns:
            return False
        # from due time to due time, so that the rate is met exactly; after a pause or a step from now on
        on_time = due_ns is not None and due_ns <= stamp_ns < due_ns + period_ns
        self._admit_ns = (due_ns if on_time and due_ns is not None else stamp_ns) + period_ns
        return True

    def _shorten(self) -> None:
        queue, channel = self._queue, self._channel
        while len(queue) > channel.buffer_items or (self._size > channel.buffer_bytes and len(queue) > 1):
            self._drop_first()
        if queue:
            self._drop_before(queue[-1].stamp_ns)

    def _drop_before(self, now_ns: int) -> None:
        """Drop what is too old at this instant."""
        queue, age_ns = self._queue, self._channel.buffer_ns
        while age_ns is not None and queue and now_ns - queue[0].stamp_ns > age_ns:
            self._drop_first()

    def _drop_first(self) -> None:
        self._size -= len(self._queue.popleft().data)
        self.dropped += 1

    def reset(self) -> None:
        """Send the newest value again: the subscriber has lost its values."""
        self._in_flight = None
        self._sent = None
        self._sent_ns = -(1 << 62)
        self._spacing_ns = 0
        self._pending = self._newest
        if self.history is not None:
            self.history.on_failed()

    def due_ns(self) -> int | None:
        """When the next item is due, or None if no item waits."""
        if self._in_flight is not None or self._limit_ns is None:
            return None
        if self._pending is not None or self._queue:
            return self._sent_ns + max(self._interval_ns, self._limit_ns)
        if self._repeat_ns and self._newest is not None:
            return self._sent_ns + max(self._repeat_ns, self._limit_ns)
        return None

    def take(self, now_ns: int, limit: int, room: int) -> list[TreeItem]:
        """Take items to be sent, at most `limit` items and about `room` bytes, at least one."""
        if self.latest_only:
            # without a waiting value it is a repetition, which `due_ns` has asked for
            item = self._pending or self._newest
            if item is None:
                return []
            self._pending = None
            self._in_flight = item
            self._measure_spacing(now_ns)
            self._sent, self._sent_ns = item.data, now_ns
            if self.history is not None:
                self.history.on_sent(item)
            return [item]
        self._drop_before(now_ns)
        if self._limit_ns:
            # at a high rate several items at once: a notification for each would cost more than the item
            limit = min(limit, max(1, min(now_ns - self._sent_ns, BURST_NS) // self._limit_ns))
        self._sent_ns = now_ns
        taken: list[TreeItem] = []
        while self._queue and len(taken) < limit and (room > 0 or not taken):
            taken.append(self._queue.popleft())
            room -= len(taken[-1].data)
        self._size -= sum(len(item.data) for item in taken)
        if self._link_rate is not None:
            self._link_rate.on_sent(taken, now_ns)
        return taken

    def _measure_spacing(self, now_ns: int) -> None:
        if self._sent is not None:
            spacing_ns = now_ns - self._sent_ns
            before_ns = self._spacing_ns or spacing_ns
            # a quarter of the difference: the shown rate follows within a few values, without jumping
            self._spacing_ns = before_ns + (spacing_ns - before_ns) // 4

    def on_acknowledged(self, items: Sequence[TreeItem], now_ns: int) -> None:
        """Items that were taken have been acknowledged."""
        if self._link_rate is not None:
            self._link_rate.on_acknowledged(items, self._waiting_ns, now_ns)
        arrived, self._in_flight = self._in_flight, None
        if self.history is not None and arrived is not None:
            self.history.on_arrived(arrived)
        self._settle_history()

    def _settle_history(self) -> None:
        if self.history is not None and self._pending is None and self._in_flight is None:
            self.history.on_settled()

    def requeue(self, items: list[TreeItem]) -> None:
        """Return items that were not delivered to the queue."""
        self._in_flight = None
        if self.latest_only:
            self._sent = None
            self._pending = self._newest
            if self.history is not None:
                self.history.on_failed()
                # the newest value waits already; twice it would arrive after itself
                self.history.requeue([item for item in items if item is not self._newest])
            return
        if self._link_rate is not None:
            self._link_rate.on_returned(items)
        # at the front, in their order: items of a stream must not overtake each other
        self._queue.extendleft(reversed(items))
        self._size += sum(len(item.data) for item in items)
        self._shorten()


def half_period_ns(resource: Resource) -> int:
    """Half of a board's period, or 0 without a rate; a value does not wait because the last was late."""
    return round(1e9 / resource.rate_hz) // 2 if resource.rate_hz > 0 else 0


def _ns(interval_s: float) -> int:
    return round(min(interval_s, INTERVAL_MAX_S) * 1e9)
