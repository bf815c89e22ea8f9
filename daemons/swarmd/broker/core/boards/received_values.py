"""Values of subscribed boards in received beacons: values of the sender, and values that it relays."""

from collections.abc import Callable, Collection
from typing import Final

from swarmd.broker.core.beacon.beacon import Beacon, RelayedValue
from swarmd.broker.core.beacon.parts.value_proof import ValueProof
from swarmd.broker.core.boards.relay_cache import RelayCache, RemoteValue
from swarmd.broker.core.membership.signatures.signature_checks import SignatureChecks, UnsignedValue
from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.broker.core.swarm.neighbour import Neighbour
from swarmd.broker.core.traffic import ChannelCounters, Counters
from swarmware.model.names import hardware_id
from swarmware.types.net import BoardSubscription

DIRECT_PERIODS: Final = 2.5
"""Declared periods since the last beacon of an origin in which relayed values of its boards are not used."""


class _Subscription:
    """A subscribed board of another node."""

    __slots__ = ("channel", "want")

    def __init__(self, want: BoardSubscription) -> None:
        self.want = want
        self.channel: ChannelCounters | None = None
        """Counters of its channel, or None until the first value."""


class ReceivedValues:
    """Subscriptions of a node, and what beacons bring for them."""

    def __init__(
        self,
        own_hw: int,
        cache: RelayCache,
        counters: Counters,
        find: Callable[[int], Neighbour | None],
        checks: SignatureChecks | None,
    ) -> None:
        """`find`: the neighbour of a hardware id; `checks`: None without keys."""
        self._checks = checks
        self._own_hw = own_hw
        self._cache = cache
        self._counters = counters
        self._find = find
        self.unsigned: list[UnsignedValue] = []
        """Refused values since they were last taken from here."""
        self._subscriptions: dict[tuple[int, int], _Subscription] = {}
        """Subscriptions by origin and data id."""

    def subscribe(self, wants: Collection[BoardSubscription]) -> list[tuple[BoardSubscription, RemoteValue]]:
        """Sets the subscriptions; returns cached values of the new ones."""
        subscriptions = {
            (hardware_id(want.platform, want.unit), want.data_id): _Subscription(want) for want in wants
        }
        cached: list[tuple[BoardSubscription, RemoteValue]] = []
        for key, subscription in subscriptions.items():
            # a value that was relayed for others is here already; the subscriber need not wait for the next
            if key not in self._subscriptions and (remote := self._cache.newest(*key)) is not None:
                cached.append((subscription.want, remote))
        self._subscriptions = subscriptions
        return cached

    def drop(self, platforms: Collection[str]) -> None:
        """Ends the subscriptions to the boards of platforms that are not members any more."""
        subscriptions = self._subscriptions.items()
        self._subscriptions = {key: one for key, one in subscriptions if one.want.platform not in platforms}

    def wants(self) -> tuple[BoardSubscription, ...]:
        """The boards that this node subscribes to."""
        return tuple(one.want for one in self._subscriptions.values())

    def path(self, origin_hw: int, data_id: int) -> str | None:
        """Path of a subscribed board, or None without a subscription."""
        subscription = self._subscriptions.get((origin_hw, data_id))
        return None if subscription is None else subscription.want.path

    def take(
        self,
        neighbour: Neighbour,
        beacon: Beacon,
        rx_ns: int,
        proof: ValueProof | None = None,
    ) -> list[tuple[BoardSubscription, RemoteValue]]:
        """Takes the values of a beacon; returns the new ones of subscribed boards. `proof`: of its own
        values."""
        found: list[tuple[BoardSubscription, RemoteValue]] = []
        hw, clock_us, cache = neighbour.hw, neighbour.clock_us, self._cache
        wants, find = self._subscriptions, self._find
        # without a hello the upper part of the sender's clock, and so the age of a value, is unknown
        if neighbour.hello is not None:
            for position, value in enumerate(beacon.values):
                remote = cache.on_own_value(hw, value, clock_us, rx_ns, proof, position)
                subscription = wants.get((hw, value.data_id))
                if subscription is not None:
                    self._count(subscription, len(value.payload), remote)
                    if remote is not None:
                        found.append((subscription.want, remote))
        relays = beacon.relays
        if self._checks is not None:
            relays = self._proven(self._checks, hw, relays, rx_ns)
        for relay in relays:
            origin_hw = relay.origin_hw
            if origin_hw == self._own_hw:
                continue
            origin_link = find(origin_hw)
            remote = None
            # the own beacons of the origin are newer than any copy
            if origin_link is not None and _is_received(origin_link, rx_ns):
                cache.on_relayed(hw, relay, rx_ns)
            else:
                remote = cache.on_value(
                    hw,
                    origin_hw,
                    relay.data_id,
                    relay.stamp_us,
                    relay.age_us,
                    relay.hops,
                    relay.packed,
                    relay.payload,
                    rx_ns,
                    relay.proof,
                    relay.position,
                )
            subscription = wants.get((origin_hw, relay.data_id))
            if subscription is not None:
                self._count(subscription, len(relay.payload), remote)
                if remote is not None:
                    found.append((subscription.want, remote))
        return found

    def _proven(
        self, checks: SignatureChecks, hw: int, relays: Collection[RelayedValue], rx_ns: int
    ) -> tuple[RelayedValue, ...]:
        """The relayed values with a valid proof; the others are not taken, and refused where the key of their
        origin is known."""
        taken: list[RelayedValue] = []
        for relay in relays:
            if relay.proof is not None and self._is_true(checks, relay, rx_ns):
                taken.append(relay)
            elif checks.is_known(relay.origin_hw):  # else its name is still to come
                self._counters.refused.unsigned_values += 1
                self.unsigned.append(UnsignedValue(hw, relay.origin_hw, relay.data_id))
        return tuple(taken)

    def _is_true(self, checks: SignatureChecks, relay: RelayedValue, rx_ns: int) -> bool:
        """Whether its origin sent a value; no proof is verified of what is not used, or of own boards."""
        is_unused = relay.origin_hw == self._own_hw or not self._cache.would_take(relay, rx_ns)
        return is_unused or checks.is_proven(relay)

    def _count(self, subscription: _Subscription, size: int, remote: RemoteValue | None) -> None:
        channel = subscription.channel
        if channel is None:
            channel = subscription.channel = self._counters.channel(subscription.want.path)
        channel.received_frames += 1
        channel.received_bytes += size
        if remote is None:
            if self._cache.was_late:
                channel.late += 1
            else:
                channel.duplicates += 1


def _is_received(origin: Neighbour, now_ns: int) -> bool:
    """Whether the origin of a relayed value is received itself, so that its own beacons have the value."""
    is_linked = origin.hello is not None and origin.state is not LinkState.DOWN
    return is_linked and now_ns - origin.received_ns <= DIRECT_PERIODS * origin.period_ns
