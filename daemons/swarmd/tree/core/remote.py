"""One other platform, as far as it is known here."""

from swarmd.tree.core.arrivals import Arrivals
from swarmd.tree.core.index import Index, Leaf
from swarmd.tree.core.interest import Wish, subscribable
from swarmware.resource import Resource


class Remote:
    """One other platform."""

    __slots__ = (
        "arrivals", "asked_hint", "asking", "checked", "confirmed", "demanded", "epoch", "failures",
        "full", "gone_ns", "hint", "index", "near", "notify_epoch", "platform", "retired", "subscribing",
        "sure", "told", "up", "wanted_of", "wants", "wish",
    )  # fmt: skip

    def __init__(self, platform: str, wish: Wish) -> None:
        self.platform = platform
        self.up = False
        self.near = False
        """Heard directly."""
        self.demanded = False
        """Somebody here wants to see its structure once."""
        self.epoch: int | None = None
        self.index: Index | None = None
        """Its structure; None: not known yet."""
        self.hint: int | None = None
        """Version last heard of."""
        self.checked: int | None = None
        """Version heard of before the last question: a rumour older than its answer is not asked about."""
        self.asked_hint: int | None = None
        self.told: tuple[int, int | None] | None = None
        """Epoch and digest that it told of itself while it was being asked."""
        self.asking = False
        self.full = False
        self.sure = False
        """It has answered since it came up."""
        self.subscribing = False
        self.wish = wish
        self.confirmed: tuple[int, int] | None = None
        """Epoch of the owner and digest of the wish that it holds."""
        self.failures = 0
        self.notify_epoch: int | None = None
        self.arrivals: dict[int, Arrivals] = {}
        """Notifications of each lane in this epoch."""
        self.gone_ns = 0
        """When it could be reached last."""
        self.retired: tuple[int, ...] = ()
        self.wants: tuple[Resource, ...] = ()
        self.wanted_of: tuple[int, int] | None = None

    @property
    def digest(self) -> int:
        """Of the structure known here; 0: none."""
        return 0 if self.index is None else self.index.digest

    @property
    def holds(self) -> bool:
        """Whether it holds exactly the subscription that is wanted, as far as is known here."""
        return self.confirmed is not None and self.confirmed == (self.epoch, self.wish.digest)

    @property
    def owes(self) -> bool:
        """Whether it must be asked: for what is wanted, or to forget what is wanted no more."""
        return not self.holds if self.wish.patterns else self.confirmed is not None

    def follows(self, item: Leaf) -> bool:
        """Whether the values of one of its resources come here."""
        return self.up and self.confirmed is not None and subscribable(item, self.wish.patterns)
