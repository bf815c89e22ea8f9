"""One platform that holds a subscription here: its lease, what it is owed, what is on its way to it."""

from swarmd.tree.core.feed import Feed
from swarmd.tree.core.interest import Wish, wish
from swarmd.tree.core.lane import Lane, Number
from swarmware.resource import Kind, Resource


class Subscriber:
    """One subscriber."""

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
        "turn",
        "up",
        "wish",
    )  # fmt: skip

    def __init__(self, platform: str, epoch: int, serial: int = 0) -> None:
        """`serial`: its notifications are numbered from the next one on."""
        self.platform = platform
        self.epoch = epoch
        self.lease_span_ns = 0
        self.lease_ns = 0
        """When it ends, counted from when the platform was reachable last."""
        self.wish: Wish = wish(frozenset(), ())
        self.feeds: dict[str, Feed] = {}
        self.beacon_boards: tuple[Resource, ...] = ()
        self.lanes = {number: Lane(number, serial) for number in Number}
        self.turn: dict[Number, str] = {}
        """Of each lane the feed that was served last: the others come before it."""
        self.structure = 0
        """Digest of the structure that the subscriber has."""
        self.structure_ns: int | None = None
        self.up = True

    def of(self, number: Number) -> list[Feed]:
        """The feeds of a lane, those first that have waited longest for their turn."""
        streams = number is Number.STREAMS
        feeds = [feed for feed in self.feeds.values() if (feed.resource.kind is Kind.STREAM) is streams]
        served = self.turn.get(number)
        for index, feed in enumerate(feeds):
            if feed.resource.path == served:
                return feeds[index + 1 :] + feeds[: index + 1]
        return feeds

    @property
    def serial(self) -> int:
        """Of its newest notification."""
        return max(lane.serial for lane in self.lanes.values())

    def hurry(self) -> None:
        """It is there."""
        self.up = True
        for lane in self.lanes.values():
            lane.hurry()

    def restarted(self, epoch: int) -> None:
        """Its tree service has forgotten what it was sent."""
        self.epoch = epoch
        for lane in self.lanes.values():
            lane.clear()
        for feed in self.feeds.values():
            feed.reset()
