"""Subscriptions of other platforms at this one: leases, feeds, and notifications to each."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from swarmd.tree.core.action import Action, SendNotify, Unwatch, Watch
from swarmd.tree.core.condition import check_rule, checked_s, rule_for
from swarmd.tree.core.feed import LATEST_ONLY, Feed
from swarmd.tree.core.index import Leaf, pattern
from swarmd.tree.core.lane import COALESCE_NS, LaneNumber, NotificationLane
from swarmd.tree.core.local import LocalTree
from swarmd.tree.core.subscriber import Subscriber
from swarmd.tree.core.subscription import Subscription, make_subscription, subscribable
from swarmd.tree.core.timers import Timers
from swarmware.model.names import check_platform
from swarmware.model.resource import Resource
from swarmware.types.net import BoardPublication, ChannelLimit
from swarmware.types.tree import SubscribeReply, SubscribeRequest, TreeItem, TreeNotify

ITEMS_LIMIT: Final = 64
FEED_LIMIT: Final = 32
"""Items of one feed in one notification: a busy stream leaves room for others."""
BYTES_LIMIT: Final = 32 * 1024
"""Bytes of values in one notification: a lost one is retransmitted whole."""
LEASE_MAX_S: Final = 3600.0
SUBSCRIBERS_LIMIT: Final = 2000
"""Bounds the memory that invented names can take; twenty times the swarm of `tests/simulation/tree`."""


class Intervals(msgspec.Struct, frozen=True, kw_only=True):
    """Intervals between notifications to a subscriber."""

    coalesce_ns: int
    """Delay of a change of the structure, so that several are sent together."""
    min_interval_ns: int
    """Minimum interval of notifications of a board without a rule or a rate."""
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""


class Subscribers:
    """Sends notifications to the subscribers of this platform's resources."""

    def __init__(
        self, own: str, tree: LocalTree, intervals: Intervals, emit: Callable[[Action], None]
    ) -> None:
        self._own = own
        self._tree = tree
        self._intervals = intervals
        self._emit = emit
        self._subscribers: dict[str, Subscriber] = {}
        self._by_path: dict[str, dict[str, Subscriber]] = {}
        self._newest: dict[str, TreeItem] = {}
        self._matched: dict[int, tuple[Leaf, ...]] = {}
        self._timers: Timers[str] = Timers()
        self._limits: tuple[ChannelLimit, ...] = ()
        self._lapsed: dict[str, None] = {}
        """Platforms whose lease ended while they were not reachable, and that are to be notified."""
        self._serial = 0
        """Largest serial of all ended subscriptions: the subscriber drops notifications with older
        serials."""
        self._lost: Counter[tuple[str, str]] = Counter()
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
        lost = self._lost.copy()
        for one in self._subscribers.values():
            for path, feed in one.feeds.items():
                if feed.dropped:
                    lost[path, one.platform] += feed.dropped
        return lost

    @property
    def feeds(self) -> int:
        """Number of pairs of subscriber and resource."""
        return sum(len(one.feeds) for one in self._subscribers.values())

    def platforms(self) -> list[str]:
        """Platforms with a lease."""
        return list(self._subscribers)

    def offers(self) -> list[BoardPublication]:
        """Boards with subscribers in the beacon, each with its shortest interval."""
        found: dict[str, BoardPublication] = {}
        for one in self._subscribers.values():
            for resource in one.beacon_boards:
                rule = rule_for(resource.path, one.subscription.rules)
                interval_s = rule.min_interval_s or (1 / resource.rate_hz if resource.rate_hz > 0 else 0.0)
                interval_ms = round(interval_s * 1000)
                known = found.get(resource.path)
                if known is None or interval_ms < known.min_interval_ms:
                    found[resource.path] = BoardPublication(
                        resource.path, resource.data_id, resource.type, interval_ms
                    )
        return [found[path] for path in sorted(found)]

    # -- from subscribers

    def on_subscribe(self, request: SubscribeRequest, now_ns: int) -> SubscribeReply:
        """A subscription or its renewal; one that is refused changes nothing.

        Raises: InvalidInput for an invalid platform, pattern, interval or lease.
        """
        check_platform(request.platform)
        reply = SubscribeReply(self._tree.epoch, self._tree.digest)
        one = self._subscribers.get(request.platform)
        held = one is not None and one.subscription.digest == request.set_digest
        if request.renew and not held:
            return msgspec.structs.replace(reply, unknown=True)
        lease_span_ns = round(checked_s("lease_s", request.lease_s, LEASE_MAX_S) * 1e9)
        if one is None and len(self._subscribers) >= SUBSCRIBERS_LIMIT:
            return msgspec.structs.replace(reply, unknown=True)
        asked = plan = None
        if not held:
            for rule in request.rules:
                check_rule(rule)
            asked = make_subscription(frozenset(request.patterns), request.rules)
            plan = self._plan(asked, {} if one is None else one.feeds)
        self._lapsed.pop(request.platform, None)
        if asked is not None and not asked.patterns:
            if one is not None:
                self._drop(one)  # it ends its subscription
            return reply
        if one is None:
            one = self._subscribers[request.platform] = Subscriber(
                request.platform, request.epoch, self._serial
            )
        one.lease_span_ns = lease_span_ns
        one.lease_ns = now_ns + lease_span_ns
        one.on_reachable()
        if one.epoch != request.epoch:
            one.restarted(request.epoch)
        if asked is not None and plan is not None:
            self.plan_version += bool(one.beacon_boards)  # the rules may be others
            one.subscription = asked
            self._set_plan(one, *plan)
        if not one.lanes[LaneNumber.UPDATES].carries_structure:
            one.structure = request.held
        # the reply has the digest: the subscriber requests a structure that differs
        one.structure_ns = None
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
        """It is not reachable: its subscription is kept until the lease ends."""
        one = self._subscribers.get(platform)
        if one is not None and one.up:
            one.up = False
            one.lease_ns = now_ns + one.lease_span_ns
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
            if lane.failing_since_ns is not None and now_ns >= lane.failing_since_ns + one.lease_span_ns:
                self._lapse(one)  # it has a route, but nothing is delivered
                return
        self._flush(one, now_ns)

    # -- from this platform

    def on_structure(self, now_ns: int) -> None:
        """The own structure has changed."""
        self._matched.clear()
        for one in self._subscribers.values():
            self._set_plan(one, *self._plan(one.subscription, one.feeds))
            if one.structure_ns is None:
                one.structure_ns = now_ns + self._intervals.coalesce_ns
            self._flush(one, now_ns)

    def on_value(self, item: TreeItem, now_ns: int) -> None:
        """A value of a watched resource."""
        if item.path not in self._by_path:
            return
        self._newest[item.path] = item
        for one in self._by_path[item.path].values():
            one.feeds[item.path].offer(item)
            self._flush(one, now_ns)

    def set_limits(self, limits: tuple[ChannelLimit, ...], now_ns: int) -> None:
        """Set the rate limits of operators; the first that matches applies."""
        self._limits = limits
        for one in self._subscribers.values():
            for path, feed in one.feeds.items():
                feed.limit(self._max_hz(path))
            self._flush(one, now_ns)

    def _max_hz(self, path: str) -> float | None:
        return next((one.max_hz for one in self._limits if pattern(one.pattern).matches(path)), None)

    def on_overrun(self, path: str, items: int) -> None:
        """Items of a watched resource were overwritten before they were read."""
        for one in self._by_path.get(path, {}).values():
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
        self._emit(SendNotify(platform, TreeNotify(self._own, self._tree.epoch, 0, lapsed=True)))

    def _drop(self, one: Subscriber) -> None:
        self._set_feeds(one, {})
        self.plan_version += bool(one.beacon_boards)
        self._serial = max(self._serial, one.serial)
        del self._subscribers[one.platform]
        self._timers.drop(one.platform)

    def _set_plan(self, one: Subscriber, beacon_boards: tuple[Resource, ...], feeds: dict[str, Feed]) -> None:
        self.plan_version += beacon_boards != one.beacon_boards
        one.beacon_boards = beacon_boards
        self._set_feeds(one, feeds)

    def _plan(
        self, asked: Subscription, held: dict[str, Feed]
    ) -> tuple[tuple[Resource, ...], dict[str, Feed]]:
        """Boards in the beacon and feeds for a subscription; existing feeds continue."""
        matched = self._matched.get(asked.digest)
        if matched is None:
            matched = tuple(_wanted(self._tree, asked.patterns))
            if len(self._matched) >= SUBSCRIBERS_LIMIT:
                self._matched.clear()
            self._matched[asked.digest] = matched
        beacon_boards = tuple(item.resource for item in matched if item.resource.link == "tick")
        feeds: dict[str, Feed] = {}
        # boards first: each has one value, a stream may fill a notification alone
        for item in sorted(matched, key=lambda item: item.resource.kind not in LATEST_ONLY):
            resource = item.resource
            if resource.link == "tick":
                continue
            rule = rule_for(resource.path, asked.rules)
            old = held.get(resource.path)
            if old is not None and old.resource == resource and old.rule == rule:
                feeds[resource.path] = old
                continue
            feed = feeds[resource.path] = Feed(resource, rule, self._intervals.min_interval_ns)
            feed.limit(self._max_hz(resource.path))
            newest = self._newest.get(resource.path)
            if newest is not None and feed.latest_only:
                feed.offer(newest)
        return beacon_boards, feeds

    def _set_feeds(self, one: Subscriber, feeds: dict[str, Feed]) -> None:
        before, one.feeds = one.feeds, feeds
        for path, feed in before.items():
            if feeds.get(path) is not feed:
                self._lost[path, one.platform] += feed.dropped
            if path not in feeds:
                readers = self._by_path[path]
                del readers[one.platform]
                if not readers:
                    del self._by_path[path]
                    self._newest.pop(path, None)
                    self._emit(Unwatch(path))
        for path, feed in feeds.items():
            readers = self._by_path.setdefault(path, {})
            changed = path in before and before[path].resource != feed.resource
            if not readers or changed:
                self._emit(Watch(feed.resource))
            if changed:
                self._newest.pop(path, None)  # its type may differ; the watch reads it again
            readers[one.platform] = one

    def _flush(self, one: Subscriber, now_ns: int) -> None:
        """Send what is due, and set the timer for the rest."""
        wake_ns = None if one.up else one.lease_ns
        if one.up:
            for lane in one.lanes.values():
                while (due_ns := self._due_ns(one, lane)) is not None and due_ns <= now_ns:
                    self._send(one, lane, now_ns)
                if due_ns is not None and (wake_ns is None or due_ns < wake_ns):
                    wake_ns = due_ns
        if wake_ns is None:
            self._timers.drop(one.platform)
        else:
            self._timers.set(one.platform, wake_ns)

    def _due_ns(self, one: Subscriber, lane: NotificationLane) -> int | None:
        """When the next notification or retransmission is due."""
        repeat_ns = lane.due_ns()
        if repeat_ns is not None:
            return repeat_ns  # retransmissions first, to keep the order
        if not lane.has_room:
            return None
        dues = [due_ns for feed in one.of(lane.number) if (due_ns := feed.due_ns()) is not None]
        if self._owes_structure(one, lane) and one.structure_ns is not None:
            dues.append(one.structure_ns)
        if not dues:
            return None
        due_ns = max(min(dues), lane.backoff_until_ns)
        return max(due_ns, lane.sent_ns + COALESCE_NS) if lane else due_ns

    def _owes_structure(self, one: Subscriber, lane: NotificationLane) -> bool:
        if one.structure == self._tree.digest:
            one.structure_ns = None
        return (
            one.structure_ns is not None and lane.number is LaneNumber.UPDATES and not lane.carries_structure
        )

    def _send(self, one: Subscriber, lane: NotificationLane, now_ns: int) -> None:
        if lane.due_ns() is not None:
            for notify in lane.repeat(now_ns):
                self._emit(SendNotify(one.platform, notify))
            return
        parts: list[tuple[Feed, list[TreeItem]]] = []
        items: list[TreeItem] = []
        size = 0
        for feed in one.of(lane.number):
            if len(items) >= ITEMS_LIMIT or size >= BYTES_LIMIT:
                break
            due_ns = feed.due_ns()
            if due_ns is not None and due_ns <= now_ns:
                taken = feed.take(now_ns, min(FEED_LIMIT, ITEMS_LIMIT - len(items)), BYTES_LIMIT - size)
                parts.append((feed, taken))
                items += taken
                size += sum(len(item.data) for item in taken)
                one.turn[lane.number] = feed.resource.path
        base = digest = 0
        structure = b""
        if self._owes_structure(one, lane):
            # also before it is due: a value must not arrive before its resource is known
            one.structure_ns = None
            base, digest = one.structure or 1, self._tree.digest
            structure = self._tree.changes_since(one.structure) or b""
        notify = TreeNotify(self._own, self._tree.epoch, 0, tuple(items), base, digest, structure)
        self._emit(SendNotify(one.platform, lane.send(notify, parts, now_ns)))


def _wanted(tree: LocalTree, patterns: tuple[str, ...]) -> Iterable[Leaf]:
    found: dict[str, Leaf] = {}
    for text in patterns:
        for item in tree.index.match(text):
            if item.resource.path not in found and subscribable(item, patterns):
                found[item.resource.path] = item
    return found.values()
