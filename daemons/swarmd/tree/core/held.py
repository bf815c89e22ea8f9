"""Subscriptions that other platforms hold here: leases, feeds, one notification on its way to each."""

from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from swarmd.tree.core.action import Action, SendNotify, Unwatch, Watch
from swarmd.tree.core.condition import check_rule, checked_s, rule_for
from swarmd.tree.core.feed import BOARDLIKE, Feed
from swarmd.tree.core.index import Leaf
from swarmd.tree.core.interest import Wish, subscribable, wish
from swarmd.tree.core.local import LocalTree
from swarmd.tree.core.timers import Timers
from swarmware.names import check_platform
from swarmware.resource import Resource
from swarmware.types.net import Offer
from swarmware.types.tree import SubscribeReply, SubscribeRequest, TreeItem, TreeNotify

ITEMS_LIMIT: Final = 64
FEED_LIMIT: Final = 32
"""Items of one feed in one notification: a busy stream leaves room for others."""
BYTES_LIMIT: Final = 32 * 1024
"""Of values in one notification: a lost one is sent again whole."""
LEASE_MAX_S: Final = 3600.0
SUBSCRIBERS_LIMIT: Final = 2000
"""Twice the largest swarm simulated (scale study, section 2)."""


class Intervals(msgspec.Struct, frozen=True, kw_only=True):
    """How eager the owner is."""

    coalesce_ns: int
    """A change of the structure waits so long for others to go with it."""
    min_interval_ns: int
    """Between two notifications of a board, where neither subscriber nor rate says more."""
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""


class _Subscriber:
    __slots__ = (
        "epoch", "failures", "feeds", "flight", "lease_ns", "platform", "quiet_ns", "structure",
        "structure_ns", "ticks", "told", "up", "wish",
    )  # fmt: skip

    def __init__(self, platform: str, epoch: int, lease_ns: int) -> None:
        self.platform = platform
        self.epoch = epoch
        self.lease_ns = lease_ns
        self.wish: Wish = wish(frozenset(), ())
        self.feeds: dict[str, Feed] = {}
        self.ticks: tuple[Resource, ...] = ()
        self.flight: list[tuple[Feed, list[TreeItem]]] | None = None
        self.told = 0
        """Digest in the notification on its way; 0: none."""
        self.structure = 0
        """Digest of the structure that the subscriber has."""
        self.structure_ns: int | None = None
        self.up = True
        self.failures = 0
        self.quiet_ns = 0
        """Nothing is sent before."""


class Held:
    """What this platform owes to others."""

    def __init__(
        self, own: str, tree: LocalTree, intervals: Intervals, emit: Callable[[Action], None]
    ) -> None:
        self._own = own
        self._tree = tree
        self._intervals = intervals
        self._emit = emit
        self._subscribers: dict[str, _Subscriber] = {}
        self._by_path: dict[str, dict[str, _Subscriber]] = {}
        self._newest: dict[str, TreeItem] = {}
        self._matched: dict[int, tuple[Leaf, ...]] = {}
        self._timers: Timers[str] = Timers()
        self._serial = 0
        self.plan_count = 0
        """Rises with each change of `offers`."""
        self.notifications = 0
        """Acknowledged by their receivers."""
        self.values = 0
        self.failures = 0
        self._dropped = 0

    # -- what there is

    @property
    def dropped(self) -> int:
        """Events that no queue had room for."""
        return self._dropped + sum(
            feed.dropped for one in self._subscribers.values() for feed in one.feeds.values()
        )

    @property
    def feeds(self) -> int:
        """Pairs of subscriber and resource."""
        return sum(len(one.feeds) for one in self._subscribers.values())

    def subscribers(self) -> list[str]:
        """Platforms with a lease."""
        return list(self._subscribers)

    def offers(self) -> list[Offer]:
        """Boards that somebody wants in the tick datagram, each with the shortest interval wanted."""
        found: dict[str, Offer] = {}
        for one in self._subscribers.values():
            for resource in one.ticks:
                rule = rule_for(resource.path, one.wish.rules)
                interval_s = rule.min_interval_s or (1 / resource.rate_hz if resource.rate_hz > 0 else 0.0)
                interval_ms = round(interval_s * 1000)
                known = found.get(resource.path)
                if known is None or interval_ms < known.min_interval_ms:
                    found[resource.path] = Offer(resource.path, resource.data_id, resource.type, interval_ms)
        return [found[path] for path in sorted(found)]

    # -- from subscribers

    def on_asked(self, request: SubscribeRequest, now_ns: int) -> SubscribeReply:
        """A subscription or its renewal; one that is refused changes nothing.

        Raises: InvalidInput for a platform, pattern, interval or lease that is none.
        """
        check_platform(request.platform)
        reply = SubscribeReply(self._tree.epoch, self._tree.digest)
        one = self._subscribers.get(request.platform)
        held = one is not None and one.wish.digest == request.set_digest
        if request.renew and not held:
            return msgspec.structs.replace(reply, unknown=True)
        lease_ns = now_ns + round(checked_s("lease_s", request.lease_s, LEASE_MAX_S) * 1e9)
        if one is None and len(self._subscribers) >= SUBSCRIBERS_LIMIT:
            return msgspec.structs.replace(reply, unknown=True)
        asked = plan = None
        if not held:
            for rule in request.rules:
                check_rule(rule)
            asked = wish(frozenset(request.patterns), request.rules)
            plan = self._plan(asked, {} if one is None else one.feeds)
        if one is None:
            one = self._subscribers[request.platform] = _Subscriber(request.platform, request.epoch, lease_ns)
        one.lease_ns = lease_ns
        one.up = True
        one.quiet_ns = one.failures = 0
        if asked is not None and plan is not None:
            self.plan_count += bool(one.ticks)  # the rules may be others
            one.wish = asked
            self._set_plan(one, *plan)
        if one.epoch != request.epoch:
            one.epoch = request.epoch
            for feed in one.feeds.values():
                feed.reset()
        if one.flight is None:
            one.structure = request.held
        # what it holds is answered here already: it asks by itself when it is not ours
        one.structure_ns = None
        self._flush(one, now_ns)
        return reply

    def on_told(self, platform: str) -> None:
        """It was sent the structure because it asked for it."""
        one = self._subscribers.get(platform)
        if one is not None:
            one.structure = self._tree.digest

    def on_up(self, platform: str, now_ns: int) -> None:
        """The platform can be reached."""
        one = self._subscribers.get(platform)
        if one is not None:
            one.up = True
            one.quiet_ns = one.failures = 0
            self._flush(one, now_ns)

    def on_gone(self, platform: str) -> None:
        """It cannot be reached: what it holds waits for it as long as its lease runs."""
        one = self._subscribers.get(platform)
        if one is not None:
            one.up = False

    def on_notified(self, platform: str, delivered: bool, now_ns: int) -> None:
        """What became of the notification on its way."""
        one = self._subscribers.get(platform)
        if one is None or one.flight is None:
            return
        flight, one.flight = one.flight, None
        if delivered:
            one.failures = 0
            self.notifications += 1
            self.values += sum(len(items) for _, items in flight)
            if one.told:
                one.structure = one.told
        else:
            self.failures += 1
            pauses = self._intervals.retry_ns
            one.quiet_ns = now_ns + pauses[min(one.failures, len(pauses) - 1)]
            one.failures += 1
            for feed, items in flight:
                feed.put_back(items)
            if one.told and one.structure_ns is None:
                one.structure_ns = now_ns
        one.told = 0
        self._flush(one, now_ns)

    # -- from this platform

    def on_structure(self, now_ns: int) -> None:
        """The own structure has changed."""
        self._matched.clear()
        for one in self._subscribers.values():
            self._set_plan(one, *self._plan(one.wish, one.feeds))
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

    def on_timer(self, now_ns: int) -> None:
        """Leases that ran out, intervals that are over, retries."""
        while (platform := self._timers.pop(now_ns)) is not None:
            one = self._subscribers.get(platform)
            if one is None:
                continue
            if now_ns >= one.lease_ns:
                self._drop(one)
            else:
                self._flush(one, now_ns)

    def deadline_ns(self) -> int | None:
        """When `on_timer` has something to do."""
        return self._timers.next_ns()

    # -- inside

    def _drop(self, one: _Subscriber) -> None:
        self._set_feeds(one, {})
        self.plan_count += bool(one.ticks)
        del self._subscribers[one.platform]

    def _set_plan(self, one: _Subscriber, ticks: tuple[Resource, ...], feeds: dict[str, Feed]) -> None:
        self.plan_count += ticks != one.ticks
        one.ticks = ticks
        self._set_feeds(one, feeds)

    def _plan(self, asked: Wish, held: dict[str, Feed]) -> tuple[tuple[Resource, ...], dict[str, Feed]]:
        """What a subscriber with this wish is owed: boards in the tick, and feeds; those it has go on."""
        matched = self._matched.get(asked.digest)
        if matched is None:
            matched = tuple(_wanted(self._tree, asked.patterns))
            if len(self._matched) >= SUBSCRIBERS_LIMIT:
                self._matched.clear()
            self._matched[asked.digest] = matched
        ticks = tuple(item.resource for item in matched if item.resource.link == "tick")
        feeds: dict[str, Feed] = {}
        # boards first: each has one value, a stream may fill a notification alone
        for item in sorted(matched, key=lambda item: item.resource.kind not in BOARDLIKE):
            resource = item.resource
            if resource.link == "tick":
                continue
            rule = rule_for(resource.path, asked.rules)
            old = held.get(resource.path)
            if old is not None and old.resource == resource and old.rule == rule:
                feeds[resource.path] = old
                continue
            feed = feeds[resource.path] = Feed(resource, rule, self._intervals.min_interval_ns)
            newest = self._newest.get(resource.path)
            if newest is not None and feed.boardlike:
                feed.offer(newest)
        return ticks, feeds

    def _set_feeds(self, one: _Subscriber, feeds: dict[str, Feed]) -> None:
        before, one.feeds = one.feeds, feeds
        for path, feed in before.items():
            if feeds.get(path) is not feed:
                self._dropped += feed.dropped
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
                self._newest.pop(path, None)  # of another type, perhaps; the watch tells it anew
            readers[one.platform] = one

    def _flush(self, one: _Subscriber, now_ns: int) -> None:
        """Send what is due, if nothing is on its way; else come back when it is."""
        wake_ns = one.lease_ns
        if one.up and one.flight is None:
            due_ns = self._due_ns(one)
            if due_ns is not None and due_ns <= now_ns:
                self._send(one, now_ns)
            elif due_ns is not None:
                wake_ns = min(wake_ns, due_ns)
        self._timers.set(one.platform, wake_ns)

    def _due_ns(self, one: _Subscriber) -> int | None:
        dues = [due_ns for feed in one.feeds.values() if (due_ns := feed.due_ns()) is not None]
        if one.structure_ns is not None:
            if one.structure == self._tree.digest:
                one.structure_ns = None
            else:
                dues.append(one.structure_ns)
        return max(min(dues), one.quiet_ns) if dues else None

    def _send(self, one: _Subscriber, now_ns: int) -> None:
        flight: list[tuple[Feed, list[TreeItem]]] = []
        items: list[TreeItem] = []
        size = 0
        for feed in one.feeds.values():
            if len(items) >= ITEMS_LIMIT or size >= BYTES_LIMIT:
                break
            due_ns = feed.due_ns()
            if due_ns is not None and due_ns <= now_ns:
                taken = feed.take(now_ns, min(FEED_LIMIT, ITEMS_LIMIT - len(items)))
                flight.append((feed, taken))
                items += taken
                size += sum(len(item.data) for item in taken)
        base = digest = 0
        structure = b""
        if one.structure_ns is not None and one.structure != self._tree.digest:
            # due or not: a value must not come before the resource is known, and the way is paid for
            one.structure_ns = None
            base, digest = one.structure or 1, self._tree.digest
            structure = self._tree.changes_since(one.structure) or b""
        self._serial += 1
        one.flight, one.told = flight, digest
        notify = TreeNotify(self._own, self._tree.epoch, self._serial, tuple(items), base, digest, structure)
        self._emit(SendNotify(one.platform, notify))


def _wanted(tree: LocalTree, patterns: tuple[str, ...]) -> Iterable[Leaf]:
    found: dict[str, Leaf] = {}
    for text in patterns:
        for item in tree.index.match(text):
            if item.resource.path not in found and subscribable(item, patterns):
                found[item.resource.path] = item
    return found.values()
