"""The tree of the swarm at one node: its own tree, replicas of others, subscriptions between them."""

from collections.abc import Iterable
from typing import Final

import msgspec

from swarmd.tree.config import Config
from swarmd.tree.core.action import Action
from swarmd.tree.core.replicas.replica import PATIENCE, ReplicaTimeouts
from swarmd.tree.core.replicas.replicas import Replicas
from swarmd.tree.core.structure.local import LocalTree, OwnerTimeouts
from swarmd.tree.core.structure.subscription import LocalSubscriptions
from swarmd.tree.core.subscribers.subscribers import Intervals, Subscribers
from swarmware.model.access import Access, Sender
from swarmware.model.names import MAIN, Address, hardware_id
from swarmware.model.resource import Kind, Link, Resource
from swarmware.runtime.loop_delay import LoopDelay
from swarmware.types.channel import ChannelLimit, ChannelProtocol, settings_of
from swarmware.types.net import LinkStatus, Neighbours, Routes, StructureBroadcast
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeItem,
    TreeNotify,
)


class Reachability(msgspec.Struct, frozen=True, gc=False):
    """How one node is reachable."""

    version: int | None
    """Version of its tree in the newest beacon or route, or None if unknown."""
    near: bool
    """Whether it is a neighbour, reachable without a hop."""
    multicast: bool = False
    """Whether it is a neighbour whose beacons come by multicast."""


def reachable(own: str, neighbours: Neighbours | None, routes: Routes | None) -> dict[str, Reachability]:
    """Every other node with a route whose name is known, by its name."""
    found: dict[str, Reachability] = {}
    for route in routes.routes if routes is not None else ():
        # a node of unknown name has a number in its place
        if route.hardware == hardware_id(route.name):
            found[route.name] = Reachability(route.tree_version or None, route.via == route.name)
    for one in neighbours.neighbours if neighbours is not None else ():
        if one.platform and one.state is LinkStatus.UP and one.hardware == hardware_id(one.name):
            found[one.name] = Reachability(one.tree_version or None, True, one.multicast)
    found.pop(own, None)
    return found


BROADCAST_LIMIT: Final = 700
"""Bytes of changes to a template in a beacon: with its head two thirds of the body. A vehicle with all its
services has 545 (`lab run formation`)."""


class SwarmTree:
    """Local tree, replicas, subscribers and subscriptions of one node."""

    def __init__(
        self,
        name: str,
        template: Iterable[Resource],
        config: Config,
        *,
        epoch: int,
        templates: Iterable[Iterable[Resource]] = (),
        keep: Iterable[str] = (),
        access: Access | None = None,
    ) -> None:
        """`name`: of this node, with its unit where that is not `main`. `epoch`: a random number of this
        start. `templates`: further templates that other platforms may have. `access`: rules of this
        platform, or None for the default ones."""
        self._actions: list[Action] = []
        emit = self._actions.append
        template = tuple(template)
        self.address = Address.parse(name)
        self.platform = self.address.platform
        retry_ns = tuple(_ns(pause_s) for pause_s in config.retry_s)
        self.local = LocalTree(
            template,
            epoch,
            OwnerTimeouts(lost_ns=_ns(config.lost_s), expire_ns=_ns(config.expire_s)),
            has_template=self.address.unit == MAIN,
        )
        rules = [rule.rule() for rule in config.rules]
        self.local_subscriptions = LocalSubscriptions(self.address, rules, keep, self.local.holds)
        intervals = Intervals(
            coalesce_ns=_ns(config.coalesce_s),
            min_interval_ns=_ns(config.min_interval_s),
            retry_ns=retry_ns,
        )
        self.subscribers = Subscribers(self.address, self.local, intervals, emit, access or Access())
        self._delay = LoopDelay()
        timeouts = ReplicaTimeouts(
            delay=self._delay,
            lease_ns=_ns(config.lease_s),
            retry_ns=retry_ns,
            forget_ns=_ns(config.forget_s),
            broadcast_ns=_ns(config.broadcast_s),
            whole_swarm=config.whole_swarm,
        )
        self.replicas = Replicas(
            self.local, self.address, self.local_subscriptions, (template, *templates), timeouts, emit
        )
        self._planned: tuple[int, int, int] | None = None
        self._unit_version = 0
        """Version of what other computers of this platform provide that the own tree has taken."""

    def _take_actions(self) -> list[Action]:
        """Return the actions of the current event, in order."""
        actions = self._actions[:]
        self._actions.clear()
        return actions

    # -- this platform

    def on_applications(
        self, provided: Iterable[Resource], patterns: Iterable[str], now_ns: int
    ) -> list[Action]:
        """Resources and read patterns of the running applications."""
        held = self.local.held_version
        # the own structure first: patterns may match what has just appeared
        if self.local.set_live(provided, now_ns):
            self.subscribers.on_structure(now_ns)
        # what runs here now is no longer expected from another computer
        changes_units = held != self.local.held_version and bool(self.replicas.units.of(self.platform))
        if changes_units:
            self._actions += self.replicas.units.prune_own()
        if self.local_subscriptions.set_patterns(patterns) or changes_units:
            self.replicas.on_subscriptions(now_ns)
        return self._take_actions()

    def _follow_units(self, now_ns: int) -> None:
        """Leave to the other computers of this platform what they provide."""
        if self._unit_version == self.replicas.unit_version:
            return
        self._unit_version = self.replicas.unit_version
        # the index first: the subscriptions leave out what it says is here
        if self.local.set_elsewhere(self.replicas.units.provided()):
            self.subscribers.on_structure(now_ns)
        self.replicas.on_subscriptions(now_ns)

    def on_values(self, items: Iterable[TreeItem], now_ns: int) -> list[Action]:
        """Values of resources that are watched, in the order in which they were written."""
        self.subscribers.on_values(items, now_ns)
        return self._take_actions()

    def on_limits(self, limits: tuple[ChannelLimit, ...], now_ns: int) -> list[Action]:
        """Rules of channels, of operators and of the file."""
        if self.local.set_links(lambda resource: _link(resource, limits)):
            self.subscribers.on_structure(now_ns)
        self.subscribers.on_limits(limits, now_ns)
        return self._take_actions()

    def on_rules(self, rules: tuple[Rule, ...], now_ns: int) -> list[Action]:
        """Rules of operators for the notifications of this platform to all its subscribers."""
        self.subscribers.on_rules(rules, now_ns)
        return self._take_actions()

    def on_access(self, now_ns: int) -> list[Action]:
        """The access rules of this platform have changed."""
        self.subscribers.on_access(now_ns)
        return self._take_actions()

    def on_demand(self, platform: str, now_ns: int) -> list[Action]:
        """An operator requests the structure of another platform; `replicas.asks`: whether a reply may
        follow."""
        self.replicas.on_demand(platform, now_ns)
        return self._take_actions()

    # -- the network

    def on_former_mirrors(self, platform: str, now_ns: int) -> list[Action]:
        """Mirrors of a platform exist from a former start; they expire like mirrors of a lost platform."""
        self.replicas.on_former_mirrors(platform, now_ns)
        return self._take_actions()

    def on_multicast(self, nodes: frozenset[str], now_ns: int) -> list[Action]:
        """The nodes whose beacons come by multicast: structures of neighbours among them come in beacons."""
        self.replicas.by_multicast = nodes
        return self._take_actions()

    def on_up(self, platform: str, version: int | None, near: bool, now_ns: int) -> list[Action]:
        """A platform is reachable, or the version of its tree or `near` has changed."""
        self.replicas.on_up(platform, version, near, now_ns)
        self.subscribers.on_up(platform, now_ns)
        return self._take_actions()

    def on_broadcast(self, broadcast: StructureBroadcast, now_ns: int) -> list[Action]:
        """The beacon of a neighbour has its structure."""
        self.replicas.on_broadcast(broadcast, now_ns)
        self._follow_units(now_ns)
        return self._take_actions()

    def on_gone(self, platform: str, now_ns: int) -> list[Action]:
        """A platform is not reachable any more."""
        self.replicas.on_gone(platform, now_ns)
        self.subscribers.on_gone(platform, now_ns)
        return self._take_actions()

    def on_removal(self, platform: str, now_ns: int) -> tuple[bool, list[Action]]:
        """A platform has left the swarm: whether it was known. Raises: Conflict when it is reachable."""
        return self.replicas.remove(platform), self._take_actions()

    def on_structure_asked(
        self, request: StructureRequest, now_ns: int
    ) -> tuple[StructureReply, list[Action]]:
        """Another tree requests the structure of this one."""
        # a request names the requester's structure: its change is noticed without a beacon
        self.replicas.on_peer_request(request.platform, request.epoch, request.digest, now_ns)
        self.subscribers.on_structure_sent(request.platform)
        return self.local.answer(request), self._take_actions()

    def on_subscribe_asked(
        self, request: SubscribeRequest, sender: Sender | None, now_ns: int
    ) -> tuple[SubscribeReply, list[Action]]:
        """Another tree subscribes here, or renews. Raises: InvalidInput."""
        self.replicas.on_peer_request(request.platform, request.epoch, None, now_ns)
        return self.subscribers.on_subscribe(request, sender, now_ns), self._take_actions()

    def on_structure(self, platform: str, reply: StructureReply | None, now_ns: int) -> list[Action]:
        """Reply to `RequestStructure`, or None without a reply."""
        self.replicas.on_structure(platform, reply, now_ns)
        self._follow_units(now_ns)
        return self._take_actions()

    def on_subscribed(
        self, platform: str, reply: SubscribeReply | None, asked: int, now_ns: int
    ) -> list[Action]:
        """Reply to `RequestSubscription` with the set digest `asked`, or None without a reply."""
        self.replicas.on_subscribed(platform, reply, asked, now_ns)
        return self._take_actions()

    def on_notify(self, notify: TreeNotify, now_ns: int) -> list[Action]:
        """A notification from an owner was received."""
        values = self.replicas.on_notify(notify, now_ns)
        self._follow_units(now_ns)
        return [*values, *self._take_actions()]

    def on_notified(self, platform: str, notify: TreeNotify, delivered: bool, now_ns: int) -> list[Action]:
        """Result of `SendNotify`: the notification was delivered, or has failed."""
        self.subscribers.on_notified(platform, notify, delivered, now_ns)
        return self._take_actions()

    # -- time

    def on_timer(self, now_ns: int) -> list[Action]:
        """Handles what is due: leases, retries, ended owners."""
        # before anything is done, while the deadline is still the one of this call
        self._delay.on_turn(self.deadline_ns(), now_ns)
        if self.local.advance(now_ns):
            self.subscribers.on_structure(now_ns)
        self.replicas.advance(now_ns)
        self._follow_units(now_ns)
        self.subscribers.advance(now_ns)
        return self._take_actions()

    def deadline_ns(self) -> int | None:
        """When `on_timer` must be called, or None without a deadline."""
        soonest = self.local.deadline_ns()
        for when in (self.replicas.deadline_ns(), self.subscribers.deadline_ns()):
            if when is not None and (soonest is None or when < soonest):
                soonest = when
        return soonest

    def patience_s(self, now_ns: int) -> float:
        """Time by which others have longer to answer, as the own node is late."""
        return PATIENCE * self._delay.recent_ns(now_ns) / 1e9

    # -- for the broker

    def broadcast(self) -> StructureBroadcast | None:
        """The own structure for the beacons, or None if it is empty or too large for them."""
        found = self.local.changes_to_template()
        # a larger structure would leave no room for values; neighbours request it instead
        if found is None or len(found.data) > BROADCAST_LIMIT:
            return None
        return StructureBroadcast(str(self.address), found.epoch, found.digest, found.base, found.data)

    def plan_changed(self) -> bool:
        """Whether publications or subscriptions of the beacon have changed since the last call."""
        now = (self.local.version, self.subscribers.plan_version, self.replicas.plan_version)
        before, self._planned = self._planned, now
        return before != now


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def _link(resource: Resource, limits: tuple[ChannelLimit, ...]) -> Link:
    """How the values of a resource travel by the rules of channels."""
    if resource.kind is not Kind.BOARD:
        return resource.link
    match settings_of(limits, resource.path).protocol:
        case ChannelProtocol.UDP:
            return "tick"
        case ChannelProtocol.ZMQ if resource.link == "tick":
            return "notify"
    return resource.link
