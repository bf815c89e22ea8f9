"""One platform with a subscription here: its lease, its feeds, and what it has to be notified of."""

from collections.abc import Iterable, Sequence
from typing import Final

from swarmd.tree.core.action import Coding
from swarmd.tree.core.notification.board_history import BoardHistory
from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.notification.lane import COALESCE_NS, LaneNumber, NotificationLane, Parts
from swarmd.tree.core.structure.subscription import NO_SUBSCRIPTION, Subscription
from swarmd.tree.core.subscribers.subscription_plan import SubscriptionPlan
from swarmware.model.access import Sender
from swarmware.model.compression import Method
from swarmware.model.resource import Kind
from swarmware.types.tree_exchange import BoardLimit

ITEMS_LIMIT: Final = 64
FEED_LIMIT: Final = 32
"""Items of one feed in one notification: a busy stream leaves room for others."""
BYTES_LIMIT: Final = 32 * 1024
"""Bytes of values in one notification: a lost one is retransmitted whole."""

_LANES: Final = {Kind.STREAM: LaneNumber.STREAMS, Kind.BOARD: LaneNumber.BOARDS}
"""All other kinds are sent with the changes of the structure."""
_IN_TURN: Final = (LaneNumber.STREAMS, LaneNumber.BACKLOG)
"""Lanes without newest values."""


class Subscriber:
    """State of one subscriber."""

    __slots__ = (
        "_behind", "_histories", "_turn", "epoch", "lanes", "lease_ns", "lease_span_ns", "limits",
        "limits_ns", "limits_sent", "over_wire", "plan", "platform", "reads", "sender", "structure",
        "structure_ns", "subscription", "up",
    )  # fmt: skip

    def __init__(self, platform: str, epoch: int, serial: int = 0, *, over_wire: bool = False) -> None:
        """`serial`: of the notification before the first one. `over_wire`: another computer of this
        platform."""
        self.platform = platform
        self.over_wire = over_wire
        self.epoch = epoch
        self.sender: Sender | None = None
        """Authenticated sender of the subscription, or None without keys."""
        self.reads: frozenset[str] = frozenset()
        """Compressions that the subscriber reads."""
        self.up = True
        self.lease_span_ns = 0
        self.lease_ns = 0
        """End of the lease, which begins when the platform was reachable last."""
        self.subscription: Subscription = NO_SUBSCRIPTION
        self.plan = SubscriptionPlan()
        self.lanes = {number: NotificationLane(number, serial) for number in LaneNumber}
        self.structure = 0
        """Digest of the structure that the subscriber has."""
        self.structure_ns: int | None = None
        """When a change of the structure is due to be sent, or None if the subscriber has the present one."""
        self.limits: tuple[BoardLimit, ...] = ()
        """Limits in force of the boards that the platform subscribes to."""
        self.limits_sent: tuple[BoardLimit, ...] = ()
        """Limits that the subscriber was sent last."""
        self.limits_ns: int | None = None
        """When changed limits are due to be sent, or None if they have not changed."""
        self._behind: set[str] = set()
        """Boards of which nothing was sent since it is reachable again: the newest value goes first."""
        self._histories: list[BoardHistory] = []
        """Former values of its boards whose channels have a buffer."""
        self._turn: dict[LaneNumber, str] = {}
        """Path of the feed that was served last in each lane, for round-robin order."""

    @property
    def feeds(self) -> dict[str, Feed]:
        """Feeds of the subscriber by path."""
        return self.plan.feeds

    @property
    def serial(self) -> int:
        """Serial number of its newest notification."""
        return max(lane.serial for lane in self.lanes.values())

    @property
    def kept_ns(self) -> int:
        """Time for which it may be unreachable: its lease, or longer for what waits in a buffer."""
        buffers_ns = (feed.channel.buffer_ns or 0 for feed in self.feeds.values())
        return max(self.lease_span_ns, *buffers_ns) if self.feeds else self.lease_span_ns

    def on_channels(self) -> None:
        """The feeds, or the settings of their channels, have changed."""
        self._histories = [feed.history for feed in self.feeds.values() if feed.history is not None]

    def on_reachable(self) -> None:
        """The subscriber is reachable, so retries happen at once."""
        if not self.up:
            self._behind = {path for path, feed in self.feeds.items() if feed.latest_only}
        self.up = True
        for lane in self.lanes.values():
            lane.reset_backoff()

    def on_restarted(self, epoch: int) -> None:
        """The subscriber's tree service has restarted and lost its values, which are sent again."""
        self.epoch = epoch
        for lane in self.lanes.values():
            lane.clear()
        for feed in self.feeds.values():
            feed.reset()

    def set_limits(self, limits: tuple[BoardLimit, ...], due_ns: int) -> None:
        """Set the limits in force, to be sent at that time if they have changed."""
        self.limits = limits
        if limits == self.limits_sent:
            self.limits_ns = None
        elif self.limits_ns is None:
            self.limits_ns = due_ns

    def take_limits(self) -> tuple[BoardLimit, ...]:
        """The limits in force, which are sent now."""
        self.limits_sent, self.limits_ns = self.limits, None
        return self.limits

    # -- its notifications

    def codings(self, paths: Iterable[str]) -> dict[str, Coding]:
        """Compressions that are set for feeds of these paths."""
        return {
            path: Coding(feed.resource.type, feed.channel.compression, self.reads)
            for path in paths
            if (feed := self.feeds.get(path)) is not None
            and feed.channel.compression.method is not Method.NONE
        }

    def due_ns(self, lane: NotificationLane) -> int | None:
        """When the next notification or retransmission of a lane is due."""
        repeat_ns = lane.due_ns()
        if repeat_ns is not None:
            return repeat_ns  # retransmissions first, to keep the order
        if not lane.has_room() or (lane and lane.number is LaneNumber.BACKLOG):
            return None  # former values one after the other: at the next outage few old ones are under way
        dues = [feed.due_ns() for feed in self._feeds_of(lane.number)]
        if self.owes_structure(lane):
            dues.append(self.structure_ns)
        if self.owes_limits(lane):
            dues.append(self.limits_ns)
        first_ns = min((due_ns for due_ns in dues if due_ns is not None), default=None)
        if first_ns is None:
            return None
        due_ns = max(first_ns, lane.backoff_until_ns)
        return max(due_ns, lane.sent_ns + COALESCE_NS) if lane and not self.over_wire else due_ns

    def owes_structure(self, lane: NotificationLane) -> bool:
        """Whether a change of the structure is to be sent in this lane; one at a time."""
        return (
            self.structure_ns is not None and lane.number is LaneNumber.UPDATES and not lane.carries_structure
        )

    def owes_limits(self, lane: NotificationLane) -> bool:
        """Whether changed limits are to be sent in this lane."""
        return self.limits_ns is not None and lane.number is LaneNumber.UPDATES

    def is_behind(self, lane: NotificationLane) -> bool:
        """Whether changes of the structure or of limits can be sent in this lane now."""
        return lane.has_room() and (self.owes_structure(lane) or self.owes_limits(lane))

    def take_items(self, lane: NotificationLane, now_ns: int) -> Parts:
        """The items for a notification, of each feed that is due."""
        parts: Parts = []
        count = size = 0
        for feed in self._feeds_of(lane.number):
            # the rest follows in the next notification, which starts with the next feed
            if count >= ITEMS_LIMIT or size >= BYTES_LIMIT:
                break
            due_ns = feed.due_ns()
            if due_ns is not None and due_ns <= now_ns:
                taken = feed.take(now_ns, min(FEED_LIMIT, ITEMS_LIMIT - count), BYTES_LIMIT - size)
                parts.append((feed, taken))
                count += len(taken)
                size += sum(len(item.data) for item in taken)
                self._turn[lane.number] = feed.resource.path
                if lane.number is not LaneNumber.BACKLOG:
                    self._behind.discard(feed.resource.path)
        return parts

    def _feeds_of(self, number: LaneNumber) -> Sequence[Feed | BoardHistory]:
        """The feeds of a lane by priority, then in round-robin order."""
        feeds: list[Feed | BoardHistory] = [*self._histories]
        if number is not LaneNumber.BACKLOG:
            feeds = [
                feed
                for feed in self.feeds.values()
                if _LANES.get(feed.resource.kind, LaneNumber.UPDATES) is number
            ]
        served = self._turn.get(number)
        # continue after the feed that was served last: none can starve the others
        for index, feed in enumerate(feeds):
            if feed.resource.path == served:
                feeds = feeds[index + 1 :] + feeds[: index + 1]
                break
        if self._behind and number not in _IN_TURN:
            feeds.sort(key=self._age)
        if any(feed.channel.priority for feed in feeds):
            feeds.sort(key=_priority)  # in turns within a priority
        return feeds

    def _age(self, feed: Feed | BoardHistory) -> tuple[bool, int]:
        """Boards that are behind, the newest value first, before what has its turn."""
        stamp_ns = feed.pending_ns if feed.resource.path in self._behind else None
        return (True, 0) if stamp_ns is None else (False, -stamp_ns)


def _priority(feed: Feed | BoardHistory) -> int:
    return -feed.channel.priority
