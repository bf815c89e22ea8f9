"""Replica of one other node: its structure, the subscription there, its notifications."""

from typing import Final

import msgspec

from swarmd.tree.core.notification.condition import rule_for
from swarmd.tree.core.notification.reorder_buffer import NotificationReceiver
from swarmd.tree.core.replicas.remote_subscription import RemoteSubscription
from swarmd.tree.core.replicas.structure_replica import StructureReplica
from swarmd.tree.core.structure.index import Index, Leaf, pattern
from swarmd.tree.core.structure.subscription import LocalSubscriptions, subscribable
from swarmware.model.names import Address
from swarmware.runtime.loop_delay import LoopDelay
from swarmware.types.net import BoardSubscription
from swarmware.types.tree_exchange import BoardLimit


class SyncState(msgspec.Struct, frozen=True):
    """Synchronisation with the platforms that are followed and reachable."""

    followed: int
    structures: int
    """Followed platforms whose structure is current here."""
    subscriptions: int
    """Followed platforms that hold the subscription of this platform."""


PATIENCE: Final = 4
"""Delays of the own event loop by which a wait for another node is longer: the question and its answer pass
the event loops of both nodes."""


class ReplicaTimeouts(msgspec.Struct, frozen=True, kw_only=True):
    """Lease, retry and retention times of replicas."""

    lease_ns: int
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""
    forget_ns: int
    delay: LoopDelay
    broadcast_ns: int
    """Time to wait for a structure in a beacon, before a request, or 0 to request it at once."""
    whole_swarm: bool = False
    """Follow every platform; else only neighbours and platforms with a subscription."""

    def structure_due_ns(self, now_ns: int) -> int:
        """When a structure that no beacon has brought is requested; later where the own node is late."""
        return now_ns + self.broadcast_ns + PATIENCE * self.delay.recent_ns(now_ns)


class Replica:
    """State for one other node."""

    __slots__ = (
        "address",
        "awaits_broadcast",
        "broadcast_missed",
        "computer_patterns",
        "demanded",
        "failures",
        "gone_ns",
        "limits",
        "matched",
        "name",
        "near",
        "notifications",
        "platform_patterns",
        "structure",
        "subscription",
        "up",
        "wants",
    )  # fmt: skip

    def __init__(self, address: Address, subscriptions: LocalSubscriptions) -> None:
        self.address = address
        self.name = str(address)
        self.platform_patterns = subscriptions.of_platform(address)
        """Patterns for its platform, whichever computer provides the resource."""
        self.computer_patterns = subscriptions.of_computer(address)
        """Patterns for exactly this computer."""
        self.up = False
        """Whether the node is reachable."""
        self.near = False
        """Whether the node is a neighbour, reachable without a hop."""
        self.gone_ns = 0
        """Instant at which the node was last reachable."""
        self.demanded = False
        """Whether a user waits for the structure."""
        self.awaits_broadcast = False
        """Whether the structure is expected in a beacon of the node."""
        self.broadcast_missed = False
        """Whether no usable structure came in a beacon in time; then it is requested instead."""
        self.structure = StructureReplica()
        self.subscription = RemoteSubscription(subscriptions.of(address))
        self.notifications = NotificationReceiver()
        self.failures = 0
        """Requests in a row without a reply."""
        self.limits: tuple[BoardLimit, ...] = ()
        """Rate limits that operators have set at the node, for subscribed boards."""
        self.wants: tuple[BoardSubscription, ...] = ()
        """Boards of the node that are expected in beacons."""
        self.matched: tuple[int, ...] | None = None
        """Digests of the structures and the subscription from which `wants` was made."""

    def set_wanted(self, subscriptions: LocalSubscriptions) -> bool:
        """Takes the changed patterns of applications; returns whether the change concerns this node."""
        platform = subscriptions.of_platform(self.address)
        computer = subscriptions.of_computer(self.address)
        wanted = subscriptions.of(self.address)
        same = (self.platform_patterns, self.computer_patterns) == (platform, computer)
        if same and wanted.digest == self.subscription.wanted.digest:
            return False
        self.platform_patterns, self.computer_patterns = platform, computer
        # the computed boards are of the former patterns
        self.matched = None
        self.subscription.set_wanted(wanted)
        return True

    @property
    def index(self) -> Index | None:
        """Resources of the node, or None if unknown."""
        return self.structure.index

    @property
    def digest(self) -> int:
        """Digest of the known structure, or 0 if unknown."""
        return self.structure.digest

    @property
    def epoch(self) -> int | None:
        """Epoch of the node's tree, or None if unknown."""
        return self.structure.epoch

    def receives(self, item: Leaf) -> bool:
        """Whether values of one of its resources are received."""
        patterns = self.subscription.wanted.patterns
        return self.up and self.subscription.is_held and subscribable(item, patterns)

    def interval_s(self, path: str) -> float:
        """Minimum time between two values of a board by its owner's rules, else by the own subscription;
        0 if only its period is known."""
        max_hz = next((one.max_hz for one in self.limits if pattern(one.pattern).matches(path)), 0.0)
        return 1 / max_hz if max_hz > 0 else rule_for(path, self.subscription.wanted.rules).min_interval_s

    def set_limits(self, limits: tuple[BoardLimit, ...]) -> None:
        """The owner has sent the limits in force. Raises: InvalidInput for an invalid pattern."""
        for one in limits:
            pattern(one.pattern)
        self.limits = limits
