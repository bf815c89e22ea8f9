"""Replicas of the trees of other nodes: structure exchange (S0.54–57) and subscriptions."""

import logging
from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from typing import Final

from swarmd.tree.core.action import Action, RemoveMirrors, RequestStructure, RequestSubscription, WriteMirror
from swarmd.tree.core.notification.lane import LaneNumber
from swarmd.tree.core.replicas.platform_units import PlatformUnits
from swarmd.tree.core.replicas.received_broadcasts import ReceivedBroadcasts
from swarmd.tree.core.replicas.replica import Replica, ReplicaTimeouts, SyncState
from swarmd.tree.core.replicas.structure_replica import StructureState
from swarmd.tree.core.structure.index import Index
from swarmd.tree.core.structure.local import LocalTree
from swarmd.tree.core.structure.structure_decoder import StructureDecoder
from swarmd.tree.core.structure.subscription import LocalSubscriptions
from swarmware.errors import Conflict, InvalidInput, OutOfRange, WireError
from swarmware.model.names import Address
from swarmware.model.resource import Resource
from swarmware.runtime.backoff import pause_after
from swarmware.runtime.timers import Timers
from swarmware.types.net import BoardSubscription, StructureBroadcast
from swarmware.types.tree_exchange import (
    BoardLimit,
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeNotify,
)

log = logging.getLogger("swarm.tree")

PLATFORMS_LIMIT: Final = 2000
"""Bounds the memory that invented names can take; twenty times the swarm of `tests/simulation/tree`."""


class _Due(StrEnum):
    """What a timer of a replica is for."""

    STRUCTURE = "structure"
    """The structure is requested again."""
    SUBSCRIPTION = "subscription"
    """The subscription is requested again."""
    FORGET = "forget"
    """The platform was not reachable for too long."""


class Replicas:
    """Requests structures, keeps replicas, subscribes."""

    def __init__(
        self,
        tree: LocalTree,
        own: Address,
        subscriptions: LocalSubscriptions,
        templates: Iterable[Iterable[Resource]],
        timeouts: ReplicaTimeouts,
        emit: Callable[[Action], None],
    ) -> None:
        self._tree = tree
        self._own = own
        self._own_name = str(own)
        self.units = PlatformUnits(own, tree)
        self._subscriptions = subscriptions
        self._timeouts = timeouts
        self._emit = emit
        self._replicas: dict[str, Replica] = {}
        self._decoder = StructureDecoder([(), *templates])
        self._timers: Timers[tuple[str, _Due]] = Timers()
        self._broadcasts = ReceivedBroadcasts(PLATFORMS_LIMIT)
        self.by_multicast: frozenset[str] = frozenset()
        """Nodes whose beacons come by multicast."""
        self.plan_version = 0
        """Incremented by each change of `wants` or `needs`."""
        self.unit_version = 0
        """Incremented by each change of what other computers of this platform provide."""

    def __iter__(self) -> Iterator[Replica]:
        return iter(self._replicas.values())

    def get(self, platform: str) -> Replica | None:
        """The replica of a node, or None if unknown."""
        return self._replicas.get(platform)

    def platforms(self) -> list[str]:
        """Names of all known nodes."""
        return list(self._replicas)

    def wants(self) -> list[BoardSubscription]:
        """Boards that are expected in beacons."""
        return [want for name in sorted(self._replicas) for want in self._replicas[name].wants]

    def needs(self) -> list[str]:
        """Neighbours whose structure is expected in a beacon."""
        return sorted(name for name, replica in self._replicas.items() if replica.awaits_broadcast)

    def sync(self) -> SyncState:
        """How many of the followed platforms agree with what is known of them here."""
        followed = [replica for replica in self if replica.up and self._is_followed(replica)]
        return SyncState(
            len(followed),
            sum(replica.structure.is_current for replica in followed),
            sum(replica.subscription.is_settled for replica in followed),
        )

    def follows(self, platform: str) -> bool:
        """Whether the structure of a platform is kept up to date here."""
        replica = self._replicas.get(platform)
        return replica is not None and replica.up and self._is_followed(replica)

    def asks(self, platform: str) -> bool:
        """Whether the reply of a structure request to it may come."""
        replica = self._replicas.get(platform)
        return replica is not None and replica.up and replica.structure.is_asking

    # -- the network

    def on_up(self, platform: str, version: int | None, near: bool, now_ns: int) -> None:
        """A node is reachable (step 1 of S0.54), `near` as a neighbour; `version` of its tree, or None."""
        replica = self._replicas.get(platform)
        if replica is None:
            if len(self._replicas) >= PLATFORMS_LIMIT and not self._make_room():
                return
            replica = self._add(platform)
        structure, subscription = replica.structure, replica.subscription
        is_back = not replica.up
        replica.up, replica.near = True, near
        if is_back:
            replica.failures = 0
            structure.on_unseen()
            subscription.on_unseen()
            self._timers.drop((platform, _Due.FORGET))
        if version is not None or structure.state is not StructureState.CURRENT:
            structure.on_advertised(version)  # a version from before its loss may be outdated
        structure.compare()
        # within half a lease it holds our subscription: a beacon with the known version confirms all
        within_lease = now_ns - replica.gone_ns < self._timeouts.lease_ns // 2
        if is_back and within_lease and structure.state is StructureState.CURRENT:
            subscription.on_verified()
        self._request_due(replica, now_ns)

    def on_gone(self, platform: str, now_ns: int) -> None:
        """A node is not reachable any more."""
        replica = self._replicas.get(platform)
        if replica is not None and replica.up:
            replica.up = False
            replica.gone_ns = now_ns
            self._timers.drop((platform, _Due.STRUCTURE))
            self._timers.drop((platform, _Due.SUBSCRIPTION))
            self._set_awaiting(replica, False)
            self._forget_later(replica, now_ns)

    def remove(self, platform: str) -> bool:
        """Forget a platform that has left the swarm, also its last values; returns True if it was known.

        Raises: Conflict when it is reachable, and would be known again at once.
        """
        found = [
            replica
            for replica in self._replicas.values()
            if replica.address.platform == platform != self._own.platform
        ]
        if any(replica.up for replica in found):
            raise Conflict(f"{platform}: reachable from {self._own}; expected a platform that has ended")
        for replica in found:
            self._timers.drop((replica.name, _Due.FORGET))
            self._forget(replica)
        return bool(found)

    def on_former_mirrors(self, platform: str, now_ns: int) -> None:
        """Mirrors of a platform exist from a former start; they expire like mirrors of a lost platform."""
        if platform == self._own.platform:
            self._timers.set((platform, _Due.FORGET), now_ns + self._timeouts.forget_ns)
            return
        platform = str(Address.parse(platform))
        if platform not in self._replicas and len(self._replicas) < PLATFORMS_LIMIT:
            replica = self._add(platform)
            replica.gone_ns = now_ns
            self._forget_later(replica, now_ns)

    def on_peer_request(self, platform: str, epoch: int, digest: int | None, now_ns: int) -> None:
        """A node sent a request with its epoch, and perhaps its digest: compare the replica."""
        replica = self._replicas.get(platform)
        if replica is not None:
            replica.structure.on_announced(epoch, digest)
            self._request_due(replica, now_ns)

    def on_broadcast(self, broadcast: StructureBroadcast, now_ns: int) -> None:
        """A neighbour's beacon has its structure."""
        self._broadcasts.put(broadcast)
        replica = self._replicas.get(broadcast.node)
        if replica is not None:
            self._request_structure(replica, now_ns)

    def _take_broadcast(self, replica: Replica, now_ns: int) -> bool:
        """Store the structure that came in a beacon, if it has the advertised version."""
        structure, reply = replica.structure, self._broadcasts.take(replica)
        index = None if reply is None else self._decode(replica, reply)
        if reply is None or index is None:
            replica.broadcast_missed |= reply is not None
            return False
        replica.broadcast_missed = False
        known, epoch = structure.index, structure.epoch
        structure.on_broadcast(reply.epoch, index)
        self._on_stored(replica, known, epoch, now_ns)
        return True

    def on_structure(self, platform: str, reply: StructureReply | None, now_ns: int) -> None:
        """Reply to a structure request (step 4 of S0.57), or None without a reply."""
        replica = self._replicas.get(platform)
        if replica is None or not replica.structure.is_asking:
            return
        structure = replica.structure
        if reply is None:
            structure.on_no_reply()
            self._retry(replica, _Due.STRUCTURE, now_ns)
            return
        index = self._decode(replica, reply)
        if index is None:
            structure.on_mismatch()
            if structure.state is StructureState.MISMATCHED:
                self._request_structure(replica, now_ns)
            else:  # the full structure is inconsistent
                self._retry(replica, _Due.STRUCTURE, now_ns)
            return
        known, epoch = structure.index, structure.epoch
        structure.on_reply(reply.epoch, index)
        self._on_stored(replica, known, epoch, now_ns)

    def _decode(self, replica: Replica, reply: StructureReply) -> Index | None:
        try:
            return self._decoder.of_reply(replica.structure.index, reply)
        except WireError as error:
            log.warning("structure of %s: %s", replica.name, error)
            return None

    def _on_stored(self, replica: Replica, known: Index | None, known_epoch: int | None, now_ns: int) -> None:
        """The structure came from the node itself: subscription and notifications follow it."""
        structure = replica.structure
        replica.failures = 0
        replica.demanded = False
        replica.notifications.on_epoch(structure.epoch or 0, known_epoch)
        replica.subscription.on_epoch(structure.epoch or 0)
        self._on_index(replica, known)
        self._request_subscription(replica)
        structure.compare()
        self._request_due(replica, now_ns)

    def on_subscribed(self, platform: str, reply: SubscribeReply | None, asked: int, now_ns: int) -> None:
        """Reply to a subscription request, or None without one; `asked`: digest of the subscription sent."""
        replica = self._replicas.get(platform)
        if replica is None or not replica.subscription.is_asking:
            return
        subscription = replica.subscription
        if reply is None:
            subscription.on_failed()
            self._retry(replica, _Due.SUBSCRIPTION, now_ns)
            return
        replica.failures = 0
        if reply.unknown:
            is_full = not subscription.is_held  # sent whole, and still unknown there: its table is full
            subscription.on_unknown()
        else:
            is_full = False
            subscription.on_confirmed(reply.epoch, asked)
            self._take_limits(replica, reply.limits)
        if is_full:
            self._retry(replica, _Due.SUBSCRIPTION, now_ns)
        else:
            self._request_subscription(replica)
        replica.structure.on_announced(reply.epoch, reply.digest)
        self._request_structure(replica, now_ns)

    def on_notify(self, notify: TreeNotify, now_ns: int) -> list[WriteMirror]:
        """Takes a notification; returns its values for mirrors. Raises: InvalidInput, WireError."""
        replica = self._replicas.get(notify.platform)
        if replica is None:
            if len(self._replicas) >= PLATFORMS_LIMIT:
                raise OutOfRange(f"{notify.platform}: no room; {PLATFORMS_LIMIT} platforms are known")
            # it has a route to this node before this node has one to it
            replica = self._add(notify.platform)
            self._forget_later(replica, now_ns)
        if replica.notifications.is_former(notify.epoch):
            return []
        if notify.lapsed:
            replica.subscription.on_ended()
            self._request_subscription(replica)
            return []
        if notify.epoch != replica.epoch:
            # it restarted, and its notification arrived before the reply with its epoch
            replica.structure.on_announced(notify.epoch, None)
            self._request_structure(replica, now_ns)
        ready = replica.notifications.take(notify)
        return [item for each in ready for item in self._accept(replica, each, now_ns)]

    def _accept(self, replica: Replica, notify: TreeNotify, now_ns: int) -> list[WriteMirror]:
        if notify.base:
            self._on_changes(replica, notify, now_ns)
        if notify.limits is not None:
            self._take_limits(replica, notify.limits)
        patterns = replica.subscription.wanted.patterns
        if notify.items and not patterns and not replica.subscription.is_held:
            replica.subscription.on_former(notify.epoch)
            self._request_subscription(replica)
        return [
            WriteMirror(name, item, notify.epoch, replica.address.unit, notify.lane == LaneNumber.BACKLOG)
            for item in notify.items
            for name in self.units.mirrors(replica, item.path)
        ]

    def _on_changes(self, replica: Replica, notify: TreeNotify, now_ns: int) -> None:
        known = replica.index
        if known is not None and known.digest == notify.digest:
            return
        try:
            index = self._decoder.of_notification(known, notify)
        except WireError as error:
            log.warning("structure of %s: %s", replica.name, error)
            index = None
        if index is None:
            replica.structure.on_changes_lost()
            self._request_structure(replica, now_ns)
        else:
            replica.structure.on_changes(index)
            self._on_index(replica, known)

    # -- this platform

    def on_demand(self, platform: str, now_ns: int) -> None:
        """A user requests the structure of a node."""
        replica = self._replicas.get(platform)
        if replica is not None and replica.up and (replica.index is None or not self._is_followed(replica)):
            replica.demanded = True
            self._request_due(replica, now_ns)

    def on_subscriptions(self, now_ns: int) -> None:
        """The subscriptions of the applications have changed."""
        for replica in self._replicas.values():
            if replica.set_wanted(self._subscriptions):
                self.plan_version += self.units.update_wants(replica.address.platform)
                replica.structure.compare()
                self._request_due(replica, now_ns)

    def advance(self, now_ns: int) -> None:
        """Retry requests, and remove platforms that were not reachable for too long."""
        while (key := self._timers.pop(now_ns)) is not None:
            platform, due = key
            replica = self._replicas.get(platform)
            match due:
                case _Due.FORGET if platform == self._own.platform and not self.units.of(platform):
                    self._emit(RemoveMirrors(platform))
                case _ if replica is None:
                    continue
                case _Due.STRUCTURE:
                    replica.broadcast_missed |= replica.awaits_broadcast
                    self._request_structure(replica, now_ns)
                case _Due.SUBSCRIPTION:
                    self._request_subscription(replica)
                case _Due.FORGET:
                    # last values are kept for the loss of a platform
                    if not self._subscriptions.keep or replica.index is None:
                        self._forget(replica)

    def deadline_ns(self) -> int | None:
        """Next call of `advance`."""
        return self._timers.next_ns()

    # -- inside

    def _add(self, platform: str) -> Replica:
        replica = Replica(Address.parse(platform), self._subscriptions)
        self._replicas[platform] = replica
        self.units.add(replica)
        return replica

    def _forget_later(self, replica: Replica, now_ns: int) -> None:
        self._timers.set((replica.name, _Due.FORGET), now_ns + self._timeouts.forget_ns)

    def _forget(self, replica: Replica) -> None:
        del self._replicas[replica.name]
        self.plan_version += bool(replica.wants) or replica.awaits_broadcast
        self._broadcasts.forget(replica.name)
        for action in self.units.remove(replica):
            self._emit(action)
        self.plan_version += self.units.update_wants(replica.address.platform)
        self._note_unit(replica)

    def _note_unit(self, replica: Replica) -> None:
        """What another computer of this platform provides may have changed."""
        self.unit_version += replica.address.platform == self._own.platform

    def _make_room(self) -> bool:
        """Remove the platform that was lost first; False if none is lost."""
        away = [replica for replica in self._replicas.values() if not replica.up]
        if away:
            self._forget(min(away, key=lambda replica: replica.gone_ns))
        return bool(away)

    def _is_followed(self, replica: Replica) -> bool:
        """Whether its tree is kept up to date, not only requested by users."""
        if replica.address.platform == self._own.platform:
            return True
        return replica.near or bool(replica.subscription.wanted.patterns) or self._timeouts.whole_swarm

    def _request_due(self, replica: Replica, now_ns: int) -> None:
        """Request what is due, now that something about it is known or wanted."""
        if not self._is_followed(replica):
            replica.structure.on_unseen()  # changes are not followed from now on
        self._request_subscription(replica)
        self._request_structure(replica, now_ns)

    def _request_structure(self, replica: Replica, now_ns: int) -> None:
        """Request the structure, if that is due and neither another reply nor a beacon will bring it."""
        structure = replica.structure
        unverified = structure.state is StructureState.UNVERIFIED
        is_due = structure.is_due or (
            unverified and (replica.demanded or not replica.subscription.will_report)
        )
        if not (is_due and replica.up and (replica.demanded or self._is_followed(replica))):
            self._set_awaiting(replica, False)
            return
        if self._take_broadcast(replica, now_ns):
            return
        if self._may_be_broadcast(replica):
            if not replica.awaits_broadcast:
                self._set_awaiting(replica, True)
                self._timers.set((replica.name, _Due.STRUCTURE), self._timeouts.structure_due_ns(now_ns))
            return
        self._set_awaiting(replica, False)
        self._timers.drop((replica.name, _Due.STRUCTURE))
        full = structure.on_asked()
        request = StructureRequest(
            self._own_name, self._tree.epoch, self._tree.digest, structure.digest, full
        )
        self._emit(RequestStructure(replica.name, request))

    def _may_be_broadcast(self, replica: Replica) -> bool:
        """Whether to wait for a beacon with the structure: one datagram serves all neighbours."""
        return (
            replica.near
            and replica.name in self.by_multicast
            and self._timeouts.broadcast_ns > 0
            and replica.structure.is_advertised
            and not replica.structure.is_mismatched
            and not (replica.demanded or replica.broadcast_missed)
            and replica.address.platform != self._own.platform
        )

    def _set_awaiting(self, replica: Replica, awaits: bool) -> None:
        if replica.awaits_broadcast != awaits:
            replica.awaits_broadcast = awaits
            self.plan_version += 1
            self._timers.drop((replica.name, _Due.STRUCTURE))

    def _request_subscription(self, replica: Replica) -> None:
        """Subscribe, renew or end the subscription, if that is due; to subscribe, after the structure."""
        subscription = replica.subscription
        wanted = subscription.wanted
        structure = replica.structure
        is_first = structure.index is None or structure.is_due or structure.is_asking
        if not (replica.up and subscription.is_due) or (wanted.patterns and is_first):
            return
        self._timers.drop((replica.name, _Due.SUBSCRIPTION))
        renew = subscription.on_asked()
        request = SubscribeRequest(
            self._own_name,
            self._tree.epoch,
            wanted.digest,
            self._timeouts.lease_ns / 1e9,
            replica.digest,
            renew,
            () if renew else wanted.patterns,
            () if renew else wanted.rules,
        )
        self._emit(RequestSubscription(replica.name, request))

    def _take_limits(self, replica: Replica, limits: tuple[BoardLimit, ...]) -> None:
        try:
            replica.set_limits(limits)
        except InvalidInput as error:
            log.warning("limits of %s: refused: %s", replica.name, error)

    def _retry(self, replica: Replica, due: _Due, now_ns: int) -> None:
        if replica.up:
            replica.failures += 1
            pauses_ns = self._timeouts.retry_ns
            self._timers.set((replica.name, due), now_ns + pause_after(replica.failures, pauses_ns))

    def _on_index(self, replica: Replica, former: Index | None) -> None:
        """The structure of a node was replaced."""
        index = replica.index or ()
        if former is None or any(item.resource.path not in index for item in former):
            for action in self.units.prune(replica):
                self._emit(action)
        self.plan_version += self.units.update_wants(replica.address.platform)
        self._note_unit(replica)
