"""Subscriptions of other platforms at this one: leases, feeds, and notifications to each."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from swarmd.tree.core.action import Action, SendNotify
from swarmd.tree.core.notification.condition import check_rule, checked_s
from swarmd.tree.core.notification.lane import LaneNumber, NotificationLane
from swarmd.tree.core.structure.local import LocalTree
from swarmd.tree.core.structure.subscription import Subscription, make_subscription
from swarmd.tree.core.subscribers.subscriber import Subscriber
from swarmd.tree.core.subscribers.subscription_plan import SubscriptionPlan, SubscriptionPlanner
from swarmd.tree.core.subscribers.watched_resources import WatchedResources
from swarmware.model.access import Access, Role, Sender
from swarmware.model.names import Address
from swarmware.runtime.timers import Timers
from swarmware.types.channel import (
    BEACON_LINK,
    NO_SETTINGS,
    ChannelLimit,
    ChannelRate,
    ChannelState,
    RateSource,
)
from swarmware.types.net import BoardPublication
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import SubscribeReply, SubscribeRequest, TreeItem, TreeNotify

LEASE_MAX_S: Final = 3600.0
CHANNELS_LIMIT: Final = 5000
"""Listed channels; an answer must fit into a frame."""
SUBSCRIBERS_LIMIT: Final = 2000
"""Bounds the memory that invented names can take; twenty times the swarm of `tests/simulation/tree`."""


class Intervals(msgspec.Struct, frozen=True, kw_only=True):
    """Delays and intervals of notifications."""

    coalesce_ns: int
    """Delay of a change of the structure, so that several are sent together."""
    min_interval_ns: int
    """Minimum interval of notifications of a board without a rule or a rate."""
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""


class Subscribers:
    """Sends notifications to the subscribers of this platform's resources."""

    def __init__(
        self,
        own: Address,
        tree: LocalTree,
        intervals: Intervals,
        emit: Callable[[Action], None],
        access: Access,
    ) -> None:
        self._own = own
        self._name = str(own)
        self._tree = tree
        self._intervals = intervals
        self._emit = emit
        self._planner = SubscriptionPlanner(self._name, tree, intervals.min_interval_ns, access)
        self._subscribers: dict[str, Subscriber] = {}
        self._watched = WatchedResources(emit)
        self._timers: Timers[str] = Timers()
        self._lapsed: dict[str, None] = {}
        """Platforms whose lease ended while they were not reachable, and that are to be notified."""
        self._serial = 0
        """Largest serial of all ended subscriptions: the subscriber drops notifications with older
        serials."""
        self.plan_version = 0
        """Incremented by each change of `offers`."""
        self.notifications = 0
        """Number of acknowledged notifications."""
        self.values = 0
        self.failures = 0

    # -- state

    @property
    def dropped(self) -> int:
        """Number of items of events and streams that were dropped from a full queue."""
        return self.losses().total()

    def losses(self) -> Counter[tuple[str, str]]:
        """Number of dropped items of each resource and subscriber."""
        lost = self._watched.lost
        for one in self._subscribers.values():
            for path, feed in one.feeds.items():
                if feed.lost:
                    lost[path, one.platform] += feed.lost
        return lost

    @property
    def feeds(self) -> int:
        """Number of pairs of subscriber and resource."""
        return sum(len(one.feeds) for one in self._subscribers.values())

    def channels(self, now_ns: int, *, every: bool = False) -> tuple[ChannelState, ...]:
        """State of the feeds of which something is set, was lost, or has its link as limit, by path and
        subscriber; `every`: of all feeds, and of the boards in beacons."""
        found = []
        for one in self._subscribers.values():
            for path, feed in one.feeds.items():
                settings = self._planner.settings(path, one.platform)
                is_thinned = feed.is_outpaced(now_ns) if feed.latest_only else feed.held_back
                if every or settings != NO_SETTINGS or feed.lost or is_thinned:
                    lost = (feed.lost, feed.held_back)
                    figures = (*feed.waiting, *lost, *feed.pace(now_ns))
                    rate = self._planner.rate(
                        feed.resource, one.subscription, one.platform, over_wire=one.over_wire
                    )
                    found.append(ChannelState(path, one.platform, settings, *figures, rate))
        if every:
            found += self._beacon_channels()
        return tuple(sorted(found, key=lambda state: (state.path, state.link))[:CHANNELS_LIMIT])

    def _beacon_channels(self) -> list[ChannelState]:
        """Boards in beacons; of the intervals that subscribers want, the shortest is in force."""
        rates: dict[str, ChannelRate] = {}
        for one in self._subscribers.values():
            for resource in one.plan.beacon_boards:
                rate = self._planner.rate(resource, one.subscription, "")
                if rate.source is RateSource.SUBSCRIBER:
                    rate = msgspec.structs.replace(rate, platform=one.platform)
                known = rates.get(resource.path)
                if known is None or _is_faster(rate, known):
                    rates[resource.path] = rate
        return [
            ChannelState(path, BEACON_LINK, self._planner.settings(path, ""), 0, 0, 0, 0, rate=rate)
            for path, rate in rates.items()
        ]

    def adapted(self) -> dict[tuple[str, str], tuple[float, str]]:
        """Streams that their link limits, by path and subscriber: the rate in Hz and the reason."""
        return {
            (path, one.platform): (rate_hz, feed.link_rate.reason)
            for one in self._subscribers.values()
            for path, feed in one.feeds.items()
            if feed.link_rate is not None and (rate_hz := feed.link_rate.rate_hz) is not None
        }

    def platforms(self) -> list[str]:
        """Platforms with a lease."""
        return list(self._subscribers)

    def offers(self) -> list[BoardPublication]:
        """Boards with subscribers in the beacon, each with its shortest interval."""
        found: dict[str, BoardPublication] = {}
        for one in self._subscribers.values():
            for resource in one.plan.beacon_boards:
                rule = self._planner.rule(resource.path, one.subscription)
                interval_s = rule.min_interval_s or (1 / resource.rate_hz if resource.rate_hz > 0 else 0.0)
                interval_ms = round(interval_s * 1000)
                known = found.get(resource.path)
                if known is None or interval_ms < known.min_interval_ms:
                    found[resource.path] = BoardPublication(
                        resource.path,
                        resource.data_id,
                        resource.type,
                        interval_ms,
                        self._planner.has_interval(resource.path),
                    )
        return [found[path] for path in sorted(found)]

    # -- from subscribers

    def on_subscribe(self, request: SubscribeRequest, sender: Sender | None, now_ns: int) -> SubscribeReply:
        """Takes a subscription or its renewal; a refusal changes nothing. `sender`: as authenticated.

        Raises: InvalidInput for an invalid platform, pattern, interval or lease.
        """
        over_wire = Address.parse(request.platform).platform == self._own.platform
        reply = SubscribeReply(self._tree.epoch, self._tree.digest)
        one = self._subscribers.get(request.platform)
        is_same = one is not None and one.subscription.digest == request.set_digest
        is_held = one is not None and is_same and _role(one.sender) == _role(sender)
        lease_span_ns = round(checked_s("lease_s", request.lease_s, LEASE_MAX_S) * 1e9)
        # known subscribers are served when the table is full: invented names cannot push them out
        is_full = one is None and len(self._subscribers) >= SUBSCRIBERS_LIMIT
        if is_full or (request.renew and not is_same):
            return msgspec.structs.replace(reply, unknown=True)
        if one is not None and is_held:
            asked, plan = one.subscription, one.plan
        else:
            asked = one.subscription if one is not None and is_same else _asked(request)
            held = {} if one is None else one.feeds
            plan = self._planner.plan(asked, held, self._watched.newest, sender, over_wire=over_wire)
        # a subscription after the end of the lease makes the message about the end superfluous
        self._lapsed.pop(request.platform, None)
        if not asked.patterns:
            if one is not None:
                self._drop(one)  # it ends its subscription
            return reply
        if one is None:
            one = Subscriber(request.platform, request.epoch, self._serial, over_wire=over_wire)
            self._subscribers[request.platform] = one
        one.sender, one.reads = sender, frozenset(request.reads)
        one.lease_span_ns = lease_span_ns
        one.lease_ns = now_ns + lease_span_ns
        one.on_reachable()
        if one.epoch != request.epoch:
            one.on_restarted(request.epoch)
        if not is_held:
            one.subscription = asked
            self.plan_version += bool(one.plan.beacon_boards)  # the rules may be others
            self._set_plan(one, plan, now_ns)
        if not one.lanes[LaneNumber.UPDATES].carries_structure:
            one.structure = request.held
        # the reply has the digest: the subscriber requests a structure that differs
        one.structure_ns = None
        reply = msgspec.structs.replace(reply, limits=one.take_limits())
        self._flush(one, now_ns)
        return reply

    def on_structure_sent(self, platform: str) -> None:
        """The structure was sent to it on request."""
        one = self._subscribers.get(platform)
        if one is not None:
            one.structure = self._tree.digest

    def on_up(self, platform: str, now_ns: int) -> None:
        """The platform is reachable."""
        if platform in self._lapsed:
            self._notify_lapsed(platform)
        one = self._subscribers.get(platform)
        if one is not None:
            one.on_reachable()
            self._flush(one, now_ns)

    def on_gone(self, platform: str, now_ns: int) -> None:
        """A subscriber is not reachable; its subscription is kept until the lease ends."""
        one = self._subscribers.get(platform)
        if one is not None and one.up:
            one.up = False
            one.lease_ns = now_ns + one.kept_ns
            self._timers.set(platform, one.lease_ns)

    def on_notified(self, platform: str, notify: TreeNotify, delivered: bool, now_ns: int) -> None:
        """A notification was delivered, or has failed."""
        if notify.lapsed:
            if delivered:
                self._lapsed.pop(platform, None)
            elif platform in self._lapsed:
                self._timers.set(platform, now_ns + self._intervals.retry_ns[-1])
            return
        one = self._subscribers.get(platform)
        if one is None:
            return
        lane = one.lanes[LaneNumber(notify.lane)]
        if delivered:
            flight = lane.delivered(notify.serial, now_ns)
            if flight is None:
                return
            self.notifications += 1
            self.values += sum(len(items) for _, items in flight.parts)
            if flight.notify.digest:
                one.structure = flight.notify.digest
                if one.structure != self._tree.digest and one.structure_ns is None:
                    one.structure_ns = now_ns
        elif lane.failed(notify.serial, now_ns, self._intervals.retry_ns):
            self.failures += 1
            # what has the lowest priority fails on a busy link, too
            failing_ns = None if lane.number is LaneNumber.BACKLOG else lane.failing_since_ns
            if failing_ns is not None and now_ns >= failing_ns + one.kept_ns:
                self._lapse(one)  # it has a route, but nothing is delivered
                return
        self._flush(one, now_ns)

    # -- from this platform

    def on_structure(self, now_ns: int) -> None:
        """The own structure has changed."""
        self._planner.on_structure()
        for one in self._subscribers.values():
            self._replan(one, now_ns)
            if one.structure_ns is None:
                one.structure_ns = now_ns + self._intervals.coalesce_ns
            self._flush(one, now_ns)

    def on_values(self, items: Iterable[TreeItem], now_ns: int) -> None:
        """Values of watched resources: each subscriber gets its own of them in one notification."""
        for one in {one.platform: one for item in items for one in self._watched.on_value(item)}.values():
            self._flush(one, now_ns)

    def on_limits(self, limits: tuple[ChannelLimit, ...], now_ns: int) -> None:
        """Rules of channels are in force; of each setting, the first that matches and has it applies."""
        self._planner.set_limits(limits)
        for one in self._subscribers.values():
            self._apply_limits(one, now_ns)
            self._flush(one, now_ns)

    def rule_of(self, path: str) -> Rule | None:
        """The operators' rule for a resource, or None if the rules of its subscribers apply."""
        return self._planner.own_rule(path)

    def on_rules(self, rules: tuple[Rule, ...], now_ns: int) -> None:
        """Rules of operators are in force for all subscribers."""
        self._planner.set_rules(rules)
        self.plan_version += 1  # intervals in the beacon
        for one in self._subscribers.values():
            self._replan(one, now_ns)
            self._flush(one, now_ns)

    def on_access(self, now_ns: int) -> None:
        """The access rules of this platform have changed."""
        for one in self._subscribers.values():
            self._replan(one, now_ns)
            self._flush(one, now_ns)

    def on_overrun(self, path: str, items: int) -> None:
        """Items of a watched resource were overwritten before they were read."""
        for one in self._watched.readers(path):
            one.feeds[path].dropped += items

    def advance(self, now_ns: int) -> None:
        """End leases, send what is due, retry."""
        while (platform := self._timers.pop(now_ns)) is not None:
            one = self._subscribers.get(platform)
            if one is None:
                if platform in self._lapsed:
                    self._notify_lapsed(platform)
            elif not one.up and now_ns >= one.lease_ns:
                self._lapse(one)
            else:
                self._flush(one, now_ns)

    def deadline_ns(self) -> int | None:
        """Next call of `advance`."""
        return self._timers.next_ns()

    # -- inside

    def _lapse(self, one: Subscriber) -> None:
        """End its lease, and notify it when it is reachable again."""
        self._drop(one)
        if len(self._lapsed) < SUBSCRIBERS_LIMIT:
            self._lapsed[one.platform] = None

    def _notify_lapsed(self, platform: str) -> None:
        self._emit(SendNotify(platform, TreeNotify(self._name, self._tree.epoch, 0, lapsed=True)))

    def _drop(self, one: Subscriber) -> None:
        self._watched.replace(one, one.feeds, {})
        self.plan_version += bool(one.plan.beacon_boards)
        # a later subscription of the same platform continues the serials
        self._serial = max(self._serial, one.serial)
        del self._subscribers[one.platform]
        self._timers.drop(one.platform)

    def _replan(self, one: Subscriber, now_ns: int) -> None:
        plan = self._planner.plan(
            one.subscription, one.feeds, self._watched.newest, one.sender, over_wire=one.over_wire
        )
        self._set_plan(one, plan, now_ns)

    def _set_plan(self, one: Subscriber, plan: SubscriptionPlan, now_ns: int) -> None:
        before, one.plan = one.plan, plan
        self.plan_version += plan.beacon_boards != before.beacon_boards
        self._watched.replace(one, before.feeds, plan.feeds)
        self._apply_limits(one, now_ns)

    def _apply_limits(self, one: Subscriber, now_ns: int) -> None:
        limits = self._planner.limit(one.plan, one.platform)
        one.set_limits(limits, now_ns + self._intervals.coalesce_ns)
        one.on_channels()

    def _flush(self, one: Subscriber, now_ns: int) -> None:
        """Send what is due, and set the timer for the rest."""
        if one.structure == self._tree.digest:
            one.structure_ns = None
        wake_ns = None if one.up else one.lease_ns
        if one.up:
            for lane in one.lanes.values():
                while (due_ns := one.due_ns(lane)) is not None and due_ns <= now_ns:
                    self._send(one, lane, now_ns)
                if due_ns is not None and (wake_ns is None or due_ns < wake_ns):
                    wake_ns = due_ns
        if wake_ns is None:
            self._timers.drop(one.platform)
        else:
            self._timers.set(one.platform, wake_ns)

    def _send(self, one: Subscriber, lane: NotificationLane, now_ns: int) -> None:
        if lane.due_ns() is not None:
            for notify in lane.repeat(now_ns):
                self._notify(one, notify)
            return
        updates = one.lanes[LaneNumber.UPDATES]
        if lane is not updates and one.is_behind(updates):
            # also before it is due: a value should not arrive before its resource and its limit are known
            self._send(one, updates, now_ns)
        parts = one.take_items(lane, now_ns)
        items = tuple(item for _, taken in parts for item in taken)
        base = digest = 0
        structure = b""
        if one.owes_structure(lane):
            one.structure_ns = None
            base, digest = one.structure or 1, self._tree.digest
            structure = self._tree.changes_since(one.structure) or b""
        limits = one.take_limits() if one.owes_limits(lane) else None
        notify = TreeNotify(self._name, self._tree.epoch, 0, items, base, digest, structure, limits=limits)
        if items or structure or limits is not None or digest:
            self._notify(one, lane.send(notify, parts, now_ns))

    def _notify(self, one: Subscriber, notify: TreeNotify) -> None:
        codings = one.codings({item.path for item in notify.items})
        self._emit(SendNotify(one.platform, notify, codings))


def _is_faster(one: ChannelRate, other: ChannelRate) -> bool:
    return other.max_hz is not None and (one.max_hz is None or one.max_hz > other.max_hz)


def _asked(request: SubscribeRequest) -> Subscription:
    for rule in request.rules:
        check_rule(rule)
    return make_subscription(frozenset(request.patterns), request.rules)


def _role(sender: Sender | None) -> Role | None:
    return None if sender is None else sender.role
