"""How the values of a subscription are sent: in beacons, by notification, with the limits of operators."""

from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from swarmd.tree.core.notification.condition import rule_for
from swarmd.tree.core.notification.feed import LATEST_ONLY, Feed
from swarmd.tree.core.structure.index import Leaf, pattern
from swarmd.tree.core.structure.local import LocalTree
from swarmd.tree.core.subscription import Subscription, subscribable
from swarmware.model.resource import Resource
from swarmware.types.net import ChannelLimit
from swarmware.types.tree import BOARD_LIMITS_LIMIT, BoardLimit, TreeItem

CACHE_LIMIT: Final = 2000
"""Subscriptions whose matches are kept: platforms of one kind have the same ones."""


class SubscriptionPlan(msgspec.Struct, frozen=True):
    """Transport of the resources that a subscription matches."""

    beacon_boards: tuple[Resource, ...] = ()
    feeds: dict[str, Feed] = {}
    """By path; of these, values are notified."""

    @property
    def board_paths(self) -> list[str]:
        """Paths of everything of which only the newest value is sent."""
        paths = [resource.path for resource in self.beacon_boards]
        return paths + [path for path, feed in self.feeds.items() if feed.latest_only]


class SubscriptionPlanner:
    """Plans subscriptions at this platform by its structure and the limits that operators have set."""

    def __init__(self, tree: LocalTree, min_interval_ns: int) -> None:
        """`min_interval_ns`: between notifications of a board without a rule or a rate."""
        self._tree = tree
        self._min_interval_ns = min_interval_ns
        self._matched: dict[int, tuple[Leaf, ...]] = {}
        self._limits: tuple[ChannelLimit, ...] = ()

    def on_structure(self) -> None:
        """The structure has changed: other resources may match."""
        self._matched.clear()

    def set_limits(self, limits: tuple[ChannelLimit, ...]) -> None:
        """Set the limits in force; the first that matches a path holds for it."""
        self._limits = limits

    def plan(
        self, subscription: Subscription, held: Mapping[str, Feed], newest: Mapping[str, TreeItem]
    ) -> SubscriptionPlan:
        """The plan for a subscription; feeds that are held continue, new ones begin with the newest value."""
        matched = self._match(subscription)
        feeds: dict[str, Feed] = {}
        # boards first: each has one value, a stream may fill a notification alone
        for item in sorted(matched, key=lambda item: item.resource.kind not in LATEST_ONLY):
            resource = item.resource
            if resource.link == "tick":
                continue
            rule = rule_for(resource.path, subscription.rules)
            feed = held.get(resource.path)
            if feed is None or feed.resource != resource or feed.rule != rule:
                feed = Feed(resource, rule, self._min_interval_ns)
                value = newest.get(resource.path)
                if value is not None and feed.latest_only:
                    feed.offer(value)
            feeds[resource.path] = feed
        return SubscriptionPlan(
            tuple(item.resource for item in matched if item.resource.link == "tick"), feeds
        )

    def limit(self, plan: SubscriptionPlan) -> tuple[BoardLimit, ...]:
        """Apply the limits in force to the feeds of a plan; returns those that hold for its boards."""
        for path, feed in plan.feeds.items():
            feed.limit(self._max_hz(path))
        if not self._limits:
            return ()
        paths = plan.board_paths
        matching = (limit for limit in self._limits if any(map(pattern(limit.pattern).matches, paths)))
        return tuple(BoardLimit(limit.pattern, limit.max_hz) for limit in matching)[:BOARD_LIMITS_LIMIT]

    def _max_hz(self, path: str) -> float | None:
        return next((one.max_hz for one in self._limits if pattern(one.pattern).matches(path)), None)

    def _match(self, subscription: Subscription) -> tuple[Leaf, ...]:
        matched = self._matched.get(subscription.digest)
        if matched is None:
            if len(self._matched) >= CACHE_LIMIT:
                self._matched.clear()
            matched = self._matched[subscription.digest] = tuple(self._find(subscription.patterns))
        return matched

    def _find(self, patterns: tuple[str, ...]) -> Iterable[Leaf]:
        found: dict[str, Leaf] = {}
        for text in patterns:
            for item in self._tree.index.match(text):
                if item.resource.path not in found and subscribable(item, patterns):
                    found[item.resource.path] = item
        return found.values()
