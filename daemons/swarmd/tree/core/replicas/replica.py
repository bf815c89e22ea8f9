"""Replica of one other platform: its structure, the subscription there, its notifications."""

from swarmd.tree.core.notification.condition import rule_for
from swarmd.tree.core.notification.reorder_buffer import NotificationReceiver
from swarmd.tree.core.replicas.remote_subscription import RemoteSubscription
from swarmd.tree.core.replicas.structure_replica import StructureReplica
from swarmd.tree.core.structure.index import Index, Leaf, pattern
from swarmd.tree.core.subscription import Subscription, subscribable
from swarmware.model.resource import Resource
from swarmware.types.tree import BoardLimit


class Replica:
    """State for one other platform."""

    __slots__ = (
        "_matched_digests", "demanded", "failures", "gone_ns", "limits", "near", "notifications",
        "platform", "structure", "subscription", "up", "wants",
    )  # fmt: skip

    def __init__(self, platform: str, wanted: Subscription) -> None:
        self.platform = platform
        self.up = False
        """It is reachable."""
        self.near = False
        """It is a neighbour: reachable without a hop."""
        self.gone_ns = 0
        """When it was reachable last."""
        self.demanded = False
        """A user has requested its structure, and did not get it yet."""
        self.structure = StructureReplica()
        self.subscription = RemoteSubscription(wanted)
        self.notifications = NotificationReceiver()
        self.failures = 0
        """Requests in a row without a reply."""
        self.limits: tuple[BoardLimit, ...] = ()
        """Limits of its rates that operators have set, for what is subscribed."""
        self.wants: tuple[Resource, ...] = ()
        """Its boards that are expected in beacons."""
        self._matched_digests: tuple[int, int] | None = None

    @property
    def index(self) -> Index | None:
        """Its resources; None: unknown."""
        return self.structure.index

    @property
    def digest(self) -> int:
        """Digest of its known structure; 0: unknown."""
        return self.structure.digest

    @property
    def epoch(self) -> int | None:
        """Epoch of its tree; None: unknown."""
        return self.structure.epoch

    def receives(self, item: Leaf) -> bool:
        """Whether values of one of its resources are received."""
        patterns = self.subscription.wanted.patterns
        return self.up and self.subscription.is_held and subscribable(item, patterns)

    def interval_s(self, path: str) -> float:
        """Time between two values of a board where subscription or operator set one; 0: its period holds."""
        interval_s = rule_for(path, self.subscription.wanted.rules).min_interval_s
        max_hz = next((one.max_hz for one in self.limits if pattern(one.pattern).matches(path)), 0.0)
        return max(interval_s, 1 / max_hz) if max_hz > 0 else interval_s

    def set_limits(self, limits: tuple[BoardLimit, ...]) -> None:
        """Its owner sent the limits in force. Raises: InvalidInput for an invalid pattern."""
        for one in limits:
            pattern(one.pattern)
        self.limits = limits

    def update_wants(self) -> bool:
        """Match structure and subscription; whether `wants` changed."""
        wanted, index = self.subscription.wanted, self.index
        digests = (self.digest, wanted.digest)
        if digests == self._matched_digests:
            return False
        self._matched_digests = digests
        found = {
            item.resource.path: item.resource
            for text in wanted.patterns
            for item in (() if index is None else index.match(text))
            if item.resource.link == "tick" and subscribable(item, wanted.patterns)
        }
        before, self.wants = self.wants, tuple(found[path] for path in sorted(found))
        return self.wants != before
