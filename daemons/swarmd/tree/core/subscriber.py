"""One platform with a subscription here: its lease, its feeds, its notifications."""

from swarmd.tree.core.feed import Feed
from swarmd.tree.core.lane import LaneNumber, NotificationLane
from swarmd.tree.core.subscription import Subscription, make_subscription
from swarmware.model.resource import Kind, Resource


class Subscriber:
    """State of one subscriber."""

    __slots__ = (
        "beacon_boards",
        "epoch",
        "feeds",
        "lanes",
        "lease_ns",
        "lease_span_ns",
        "platform",
        "structure",
        "structure_ns",
        "subscription",
        "turn",
        "up",
    )  # fmt: skip

    def __init__(self, platform: str, epoch: int, serial: int = 0) -> None:
        """`serial`: of the notification before the first one."""
        self.platform = platform
        self.epoch = epoch
        self.lease_span_ns = 0
        self.lease_ns = 0
        """End of the lease, which begins when the platform was reachable last."""
        self.subscription: Subscription = make_subscription(frozenset(), ())
        self.feeds: dict[str, Feed] = {}
        self.beacon_boards: tuple[Resource, ...] = ()
        self.lanes = {number: NotificationLane(number, serial) for number in LaneNumber}
        self.turn: dict[LaneNumber, str] = {}
        """Path of the feed that was served last in each lane, for round-robin order."""
        self.structure = 0
        """Digest of the structure that the subscriber has."""
        self.structure_ns: int | None = None
        self.up = True

    def of(self, number: LaneNumber) -> list[Feed]:
        """The feeds of a lane in round-robin order."""
        streams = number is LaneNumber.STREAMS
        feeds = [feed for feed in self.feeds.values() if (feed.resource.kind is Kind.STREAM) is streams]
        served = self.turn.get(number)
        for index, feed in enumerate(feeds):
            if feed.resource.path == served:
                return feeds[index + 1 :] + feeds[: index + 1]
        return feeds

    @property
    def serial(self) -> int:
        """Serial number of its newest notification."""
        return max(lane.serial for lane in self.lanes.values())

    def on_reachable(self) -> None:
        """It is reachable: retry at once."""
        self.up = True
        for lane in self.lanes.values():
            lane.reset_backoff()

    def restarted(self, epoch: int) -> None:
        """Its tree service has restarted and lost its values: send them again."""
        self.epoch = epoch
        for lane in self.lanes.values():
            lane.clear()
        for feed in self.feeds.values():
            feed.reset()
