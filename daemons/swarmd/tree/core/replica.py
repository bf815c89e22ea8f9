"""Replica of the tree of one other platform."""

from swarmd.tree.core.index import Index, Leaf
from swarmd.tree.core.reorder_buffer import ReorderBuffer
from swarmd.tree.core.subscription import Subscription, subscribable
from swarmware.model.resource import Resource


class Replica:
    """State of one other platform: its structure, and the subscription there."""

    __slots__ = (
        "advertised", "advertised_at_request", "announced", "confirmed", "confirmed_since_up", "demanded",
        "epoch", "failures", "former_epochs", "gone_ns", "index", "matched_digests", "near",
        "notify_epoch", "platform", "reorder_buffers", "request_full", "structure_requested",
        "subscription", "subscription_requested", "up", "verified", "wants",
    )  # fmt: skip

    def __init__(self, platform: str, subscription: Subscription) -> None:
        self.platform = platform
        self.up = False
        self.near = False
        """It is a neighbour: reachable without a hop."""
        self.demanded = False
        """A user has requested its structure once."""
        self.epoch: int | None = None
        self.index: Index | None = None
        """Its structure; None: unknown."""
        self.advertised: int | None = None
        """Version of its tree in the newest beacon or route; None: unknown."""
        self.verified: int | None = None
        """Version that was advertised before the last request: a report older than the reply is ignored."""
        self.advertised_at_request: int | None = None
        self.announced: tuple[int, int | None] | None = None
        """Epoch and digest that it sent itself since the last request."""
        self.structure_requested = False
        self.request_full = False
        self.confirmed_since_up = False
        """It has confirmed structure and subscription since it became reachable."""
        self.subscription_requested = False
        self.subscription = subscription
        self.confirmed: tuple[int, int] | None = None
        """Epoch of the owner and digest of the subscription that it holds."""
        self.failures = 0
        self.notify_epoch: int | None = None
        self.reorder_buffers: dict[int, ReorderBuffer] = {}
        """Reorder buffer of each lane in this epoch."""
        self.gone_ns = 0
        """When it was reachable last."""
        self.former_epochs: tuple[int, ...] = ()
        self.wants: tuple[Resource, ...] = ()
        self.matched_digests: tuple[int, int] | None = None

    @property
    def digest(self) -> int:
        """Digest of the known structure; 0: unknown."""
        return 0 if self.index is None else self.index.digest

    @property
    def is_subscribed(self) -> bool:
        """Whether it has confirmed exactly the present subscription."""
        return self.confirmed is not None and self.confirmed == (self.epoch, self.subscription.digest)

    @property
    def must_subscribe(self) -> bool:
        """Whether the subscription there must be sent, changed or ended."""
        return not self.is_subscribed if self.subscription.patterns else self.confirmed is not None

    def receives(self, item: Leaf) -> bool:
        """Whether values of one of its resources are received."""
        return self.up and self.confirmed is not None and subscribable(item, self.subscription.patterns)
