"""Replicas of the trees of other platforms: structure exchange (S0.54–57) and subscriptions."""

import logging
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import msgspec

from swarmd.tree.core import structure
from swarmd.tree.core.action import Action, PruneMirrors, RemoveMirrors, RequestStructure, RequestSubscription
from swarmd.tree.core.index import Index, Leaf, leaf, pattern
from swarmd.tree.core.local import LocalTree
from swarmd.tree.core.reorder_buffer import ReorderBuffer
from swarmd.tree.core.replica import Replica
from swarmd.tree.core.structure import Patches, StructureEncoding
from swarmd.tree.core.subscription import NO_SUBSCRIPTION, LocalSubscriptions, subscribable
from swarmd.tree.core.timers import Timers
from swarmware.errors import OutOfRange, WireError
from swarmware.model.names import check_platform
from swarmware.model.resource import Resource
from swarmware.types.net import BoardSubscription
from swarmware.types.tree import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeItem,
    TreeNotify,
)

log = logging.getLogger("swarm.tree")

UNKNOWN_SUBSCRIPTION: Final = -1
"""Digest of a subscription of an earlier start of this tree."""
FORMER_EPOCHS: Final = 8
"""Former epochs of another tree whose late notifications are recognised."""
TEMPLATES_LIMIT: Final = 64
"""Templates of other platforms that are kept."""
PLATFORMS_LIMIT: Final = 2000
"""Bounds the memory that invented names can take; twenty times the swarm of `tests/simulation/tree`."""


class ReplicaTimeouts(msgspec.Struct, frozen=True, kw_only=True):
    """Lease, retry and retention times of replicas."""

    lease_ns: int
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""
    forget_ns: int
    whole_swarm: bool = False
    """Follow every platform; else neighbours, and those with a subscription."""


class Replicas:
    """Requests structures, keeps replicas, subscribes."""

    def __init__(
        self,
        tree: LocalTree,
        own: str,
        interests: LocalSubscriptions,
        templates: Iterable[Iterable[Resource]],
        timeouts: ReplicaTimeouts,
        emit: Callable[[Action], None],
    ) -> None:
        self._tree = tree
        self._own = own
        self._subscriptions = interests
        self._timeouts = timeouts
        self._emit = emit
        self._replicas: dict[str, Replica] = {}
        self._templates: dict[int, Index] = {}
        for template in templates:
            index = Index(leaf(resource) for resource in template)
            self._templates[index.digest] = index
        self._patches = Patches()
        self._timers: Timers[tuple[str, str]] = Timers()
        self.plan_version = 0
        """Incremented by each change of `wants`."""

    def __iter__(self) -> Iterator[Replica]:
        return iter(self._replicas.values())

    def get(self, platform: str) -> Replica | None:
        """The replica of a platform; None: unknown."""
        return self._replicas.get(platform)

    def platforms(self) -> list[str]:
        """Names of all known platforms."""
        return list(self._replicas)

    def wants(self) -> list[BoardSubscription]:
        """Boards that are expected in beacons."""
        return [
            BoardSubscription(platform, resource.path, resource.type, resource.data_id)
            for platform in sorted(self._replicas)
            for resource in self._replicas[platform].wants
        ]

    # -- the network

    def on_up(self, platform: str, version: int | None, near: bool, now_ns: int) -> None:
        """It is reachable (step 1 of S0.54), `near`: as a neighbour. `version` of its tree; None: unknown."""
        replica = self._replicas.get(platform)
        if replica is None:
            if len(self._replicas) >= PLATFORMS_LIMIT and not self._make_room():
                return
            replica = self._replicas[platform] = Replica(platform, self._subscriptions.of(platform))
        if version is not None or not (replica.up and replica.confirmed_since_up):
            if version != replica.advertised:
                replica.verified = None  # a structure may return to a former version
            replica.advertised = version  # a version from before its loss may be outdated
        replica.near = near
        if not replica.up:
            replica.up = True
            # within half a lease it holds our subscription: a beacon with the known version confirms all
            away = now_ns - replica.gone_ns >= self._timeouts.lease_ns // 2
            replica.confirmed_since_up = version is not None and not away and self._is_in_sync(replica)
            replica.failures = 0
            self._timers.drop((platform, "forget"))
        self._synchronise(replica)

    def on_former_mirrors(self, platform: str, now_ns: int) -> None:
        """Mirrors of it exist from a former start: they expire like those of a lost platform."""
        if platform not in self._replicas and len(self._replicas) < PLATFORMS_LIMIT:
            replica = self._replicas[platform] = Replica(platform, self._subscriptions.of(platform))
            replica.gone_ns = now_ns
            self._timers.set((platform, "forget"), now_ns + self._timeouts.forget_ns)

    def demand(self, platform: str) -> None:
        """A user requests its structure."""
        replica = self._replicas.get(platform)
        if replica is None or not replica.up:
            return
        if replica.index is None or not self._is_followed(replica):
            replica.demanded = True
            self._request_structure(replica)

    def asks(self, platform: str) -> bool:
        """Whether an answer of it may come."""
        replica = self._replicas.get(platform)
        return replica is not None and replica.up and replica.structure_requested

    def on_gone(self, platform: str, now_ns: int) -> None:
        """It is not reachable any more."""
        replica = self._replicas.get(platform)
        if replica is not None and replica.up:
            replica.up = False
            replica.gone_ns = now_ns
            for what in ("ask", "subscribe"):
                self._timers.drop((platform, what))
            self._timers.set((platform, "forget"), now_ns + self._timeouts.forget_ns)

    def on_peer_request(self, platform: str, epoch: int, digest: int | None) -> None:
        """It sent a request with its epoch, and perhaps its digest: verify the replica."""
        replica = self._replicas.get(platform)
        if replica is None:
            return
        replica.announced = (epoch, digest)
        self._verify(replica)

    def on_structure(self, platform: str, reply: StructureReply | None, now_ns: int) -> None:
        """Reply to a structure request (step 4 of S0.57); None: there was none."""
        replica = self._replicas.get(platform)
        if replica is None or not replica.structure_requested:
            return
        replica.structure_requested = False
        if reply is None:
            self._retry(replica, "ask", now_ns)
            return
        full = replica.request_full
        replica.request_full = False
        try:
            index = self._decode_reply(replica, reply)
        except WireError as error:
            log.warning("structure of %s: %s", platform, error)
            index = None
        if index is None:
            if full:  # the full structure is inconsistent: retry later
                self._retry(replica, "ask", now_ns)
                return
            replica.request_full = True
            self._request_structure(replica)
            return
        replica.verified = replica.advertised_at_request
        replica.failures = 0
        self._store_structure(replica, reply.epoch, index)
        replica.demanded = False
        if replica.confirmed is not None and replica.confirmed[0] != replica.epoch:
            replica.confirmed = None  # it restarted
        if replica.must_subscribe or (replica.subscription.patterns and not replica.confirmed_since_up):
            self._subscribe(replica)
        else:
            replica.confirmed_since_up = True
        self._verify(replica)

    def on_subscribed(self, platform: str, reply: SubscribeReply | None, asked: int, now_ns: int) -> None:
        """Reply to a subscription request; None: there was none. `asked`: digest of the subscription sent."""
        replica = self._replicas.get(platform)
        if replica is None or not replica.subscription_requested:
            return
        replica.subscription_requested = False
        if reply is None:
            self._retry(replica, "subscribe", now_ns)
            return
        replica.failures = 0
        replica.confirmed_since_up = True
        if reply.unknown:
            again = replica.confirmed is None
            replica.confirmed = None
            if again:  # sent whole, and still unknown there: its table is full
                self._retry(replica, "subscribe", now_ns)
            else:
                self._subscribe(replica)
        else:
            replica.confirmed = None if asked == NO_SUBSCRIPTION.digest else (reply.epoch, asked)
            if replica.must_subscribe:
                self._subscribe(replica)
        replica.announced = (reply.epoch, reply.digest)
        self._verify(replica)

    def on_notify(self, notify: TreeNotify, now_ns: int) -> list[TreeItem]:
        """A notification; returns its values for mirrors. Raises: InvalidInput, WireError."""
        replica = self._replicas.get(notify.platform)
        if replica is None:
            check_platform(notify.platform)
            if len(self._replicas) >= PLATFORMS_LIMIT:
                raise OutOfRange(f"{notify.platform}: no room; {PLATFORMS_LIMIT} platforms are known")
            # it has a route to this node before this node has one to it
            replica = self._replicas[notify.platform] = Replica(
                notify.platform, self._subscriptions.of(notify.platform)
            )
            self._timers.set((notify.platform, "forget"), now_ns + self._timeouts.forget_ns)
        if notify.epoch in replica.former_epochs:
            return []
        if notify.lapsed:
            replica.confirmed = None
            if replica.must_subscribe:
                self._subscribe(replica)
            return []
        if notify.epoch != replica.notify_epoch:
            replica.notify_epoch, replica.reorder_buffers = notify.epoch, {}
        if notify.epoch != replica.epoch:
            # it restarted, and its notification arrived before the reply with its epoch
            replica.announced = (notify.epoch, None)
            self._verify(replica)
        arrivals = replica.reorder_buffers.setdefault(notify.lane, ReorderBuffer())
        return [item for ready in arrivals.take(notify) for item in self._accept(replica, ready)]

    def _accept(self, replica: Replica, notify: TreeNotify) -> list[TreeItem]:
        if notify.base:
            self._on_changes(replica, notify)
        patterns = replica.subscription.patterns
        if notify.items and not patterns and replica.confirmed is None:
            # it still holds a subscription of a former start of this tree
            replica.confirmed = (notify.epoch, UNKNOWN_SUBSCRIPTION)
            self._subscribe(replica)
        return [item for item in notify.items if any(pattern(text).matches(item.path) for text in patterns)]

    # -- this platform

    def on_subscriptions(self) -> None:
        """The subscriptions of the applications have changed."""
        for replica in self._replicas.values():
            subscription = self._subscriptions.of(replica.platform)
            if subscription.digest != replica.subscription.digest:
                replica.subscription = subscription
                self._update_wants(replica)
                self._synchronise(replica)
                if replica.index is not None:
                    self._subscribe(replica)

    def on_timer(self, now_ns: int) -> None:
        """Retry requests, and remove platforms that were not reachable for too long."""
        while (key := self._timers.pop(now_ns)) is not None:
            platform, what = key
            replica = self._replicas.get(platform)
            if replica is None:
                continue
            if what == "forget":
                # last values are kept for the loss of a platform
                if not self._subscriptions.keep or replica.index is None:
                    self._forget(replica)
            elif what == "ask":
                self._request_structure(replica)
            else:
                self._subscribe(replica)

    def deadline_ns(self) -> int | None:
        """Next call of `on_timer`."""
        return self._timers.next_ns()

    # -- inside

    def _forget(self, replica: Replica) -> None:
        del self._replicas[replica.platform]
        self.plan_version += bool(replica.wants)
        self._emit(RemoveMirrors(replica.platform))

    def _make_room(self) -> bool:
        """Remove the platform that was lost first; False if none is lost."""
        away = [replica for replica in self._replicas.values() if not replica.up]
        if away:
            self._forget(min(away, key=lambda replica: replica.gone_ns))
        return bool(away)

    def _is_followed(self, replica: Replica) -> bool:
        """Whether its tree is kept up to date, not only requested by users."""
        return replica.near or bool(replica.subscription.patterns) or self._timeouts.whole_swarm

    def _synchronise(self, replica: Replica) -> None:
        """Request what is missing, now that it is reachable, a neighbour or subscribed."""
        if not replica.up:
            return
        if not self._is_followed(replica):
            replica.confirmed_since_up = False  # changes are not followed from now on
            return
        if replica.index is None or not self._is_current(replica):
            self._verify(replica)
        elif not replica.confirmed_since_up or replica.must_subscribe:
            # it was known before: the reply to the renewal has both digests
            self._subscribe(replica)
        else:
            self._verify(replica)

    def _is_in_sync(self, replica: Replica) -> bool:
        """Whether structure and subscription are up to date."""
        return not replica.must_subscribe and replica.index is not None and self._matches_advertised(replica)

    def _matches_advertised(self, replica: Replica) -> bool:
        return replica.epoch is not None and replica.advertised == structure.version(
            replica.epoch, replica.digest
        )

    def _is_current(self, replica: Replica) -> bool:
        """Whether the structure is the one advertised last."""
        if replica.advertised is None or replica.advertised == replica.verified:
            return replica.index is not None
        return self._matches_advertised(replica)

    def _verify(self, replica: Replica) -> None:
        """Request the structure if a report since the last request has another digest or epoch."""
        if replica.structure_requested or not replica.up or not self._is_followed(replica):
            return
        announced, replica.announced = replica.announced, None
        changed = announced is not None and (
            announced[0] != replica.epoch or (announced[1] is not None and announced[1] != replica.digest)
        )
        if changed or not self._is_current(replica):
            self._request_structure(replica)

    def _request_structure(self, replica: Replica) -> None:
        if (
            replica.up
            and not replica.structure_requested
            and (replica.demanded or self._is_followed(replica))
        ):
            replica.structure_requested = True
            replica.advertised_at_request, replica.announced = replica.advertised, None
            self._timers.drop((replica.platform, "ask"))
            request = StructureRequest(
                self._own, self._tree.epoch, self._tree.digest, replica.digest, replica.request_full
            )
            self._emit(RequestStructure(replica.platform, request))

    def _subscribe(self, replica: Replica) -> None:
        """Subscribe, or renew the subscription; without one, compare the structure."""
        if not replica.up or replica.subscription_requested:
            return
        if not replica.subscription.patterns and replica.confirmed is None:
            if replica.index is not None and not self._matches_advertised(replica):
                self._request_structure(replica)
            return
        subscription = replica.subscription
        replica.subscription_requested = True
        self._timers.drop((replica.platform, "subscribe"))
        renew = replica.is_subscribed
        request = SubscribeRequest(
            self._own,
            self._tree.epoch,
            subscription.digest,
            self._timeouts.lease_ns / 1e9,
            replica.digest,
            renew,
            () if renew else subscription.patterns,
            () if renew else subscription.rules,
        )
        self._emit(RequestSubscription(replica.platform, request))

    def _retry(self, replica: Replica, what: str, now_ns: int) -> None:
        if replica.up:
            pauses = self._timeouts.retry_ns
            self._timers.set(
                (replica.platform, what), now_ns + pauses[min(replica.failures, len(pauses) - 1)]
            )
            replica.failures += 1

    def _decode_reply(self, replica: Replica, reply: StructureReply) -> Index | None:
        """Structure in the reply; None if its base is unknown or its digest differs."""
        if reply.form == StructureEncoding.UNCHANGED:
            index = replica.index
        else:
            patch = self._patches.decode(reply.data)
            index = self._base_index(replica, reply, patch.template)
            if index is not None:
                patch.apply(index)
        return index if index is not None and index.digest == reply.digest else None

    def _base_index(
        self, replica: Replica, reply: StructureReply, template: tuple[Leaf, ...]
    ) -> Index | None:
        if reply.form == StructureEncoding.CHANGES:
            return None if replica.index is None else replica.index.copy()
        known = self._templates.get(reply.base)
        if known is None and reply.form == StructureEncoding.FULL:
            known = Index(template)  # bounded by the decoder
            if known.digest != reply.base:
                return None
            while len(self._templates) >= TEMPLATES_LIMIT:
                del self._templates[next(iter(self._templates))]
            self._templates[reply.base] = known
        return None if known is None else known.copy()

    def _store_structure(self, replica: Replica, epoch: int, index: Index) -> None:
        for former in (replica.epoch, replica.notify_epoch):
            if former is not None and former != epoch and former not in replica.former_epochs:
                replica.former_epochs = (*replica.former_epochs, former)[-FORMER_EPOCHS:]
        if epoch in replica.former_epochs:
            replica.former_epochs = tuple(one for one in replica.former_epochs if one != epoch)
        replica.epoch = epoch
        self._set_index(replica, index)

    def _set_index(self, replica: Replica, index: Index) -> None:
        former, replica.index = replica.index, index
        if former is None or any(item.resource.path not in index for item in former):
            self._emit(PruneMirrors(replica.platform, frozenset(item.resource.path for item in index)))
        self._update_wants(replica)

    def _on_changes(self, replica: Replica, notify: TreeNotify) -> None:
        index = replica.index
        if index is not None and index.digest == notify.digest:
            return
        if index is not None and index.digest == notify.base and notify.structure:
            try:
                index = index.copy()
                self._patches.decode(notify.structure).apply(index)
            except WireError as error:
                log.warning("structure of %s: %s", replica.platform, error)
            else:
                if index.digest == notify.digest:
                    self._set_index(replica, index)
                    return
        self._request_structure(replica)

    def _update_wants(self, replica: Replica) -> None:
        """Update the boards that are expected in its beacons."""
        key = (replica.digest, replica.subscription.digest)
        if replica.matched_digests == key:
            return
        replica.matched_digests = key
        patterns = replica.subscription.patterns
        wanted = {
            item.resource.path: item.resource
            for text in patterns
            for item in (replica.index.match(text) if replica.index is not None else ())
            if item.resource.link == "tick" and subscribable(item, patterns)
        }
        wants = tuple(wanted[path] for path in sorted(wanted))
        if wants != replica.wants:
            replica.wants = wants
            self.plan_version += 1
