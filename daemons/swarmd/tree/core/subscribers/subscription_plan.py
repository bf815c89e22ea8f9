"""How the values of a subscription are sent: in beacons or by notification, how often, and who decided it."""

from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from swarmd.tree.core.notification.condition import first_rule, rule_for
from swarmd.tree.core.notification.feed import LATEST_ONLY, Feed, half_period_ns
from swarmd.tree.core.structure.index import Leaf
from swarmd.tree.core.structure.local import LocalTree
from swarmd.tree.core.structure.subscription import Subscription, subscribable
from swarmware.model.access import Access, Sender, Verb
from swarmware.model.resource import Resource
from swarmware.types.channel import (
    RATE_MAX_HZ,
    ChannelLimit,
    ChannelRate,
    ChannelSettings,
    RateSource,
    rate_rule,
    settings_of,
)
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import BOARD_LIMITS_LIMIT, BoardLimit, TreeItem

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

    def __init__(self, own: str, tree: LocalTree, min_interval_ns: int, access: Access) -> None:
        """`own`: name of this node; `min_interval_ns`: between notifications of a board without a rule or a
        rate; `access`: rules of this platform."""
        self._own = own
        self._access = access
        self._tree = tree
        self._min_interval_ns = min_interval_ns
        self._matched: dict[int, tuple[Leaf, ...]] = {}
        self._limits: tuple[ChannelLimit, ...] = ()
        self._rules: tuple[Rule, ...] = ()

    def on_structure(self) -> None:
        """The structure has changed: other resources may match."""
        self._matched.clear()

    def set_limits(self, limits: tuple[ChannelLimit, ...]) -> None:
        """Set the limits in force; the first that matches a path holds for it."""
        self._limits = limits

    def set_rules(self, rules: tuple[Rule, ...]) -> None:
        """Set the operators' rules; the first that matches a path holds for all subscribers."""
        self._rules = rules

    def own_rule(self, path: str) -> Rule | None:
        """The operators' rule for a path, or None without one."""
        return first_rule(path, self._rules)

    def rule(self, path: str, subscription: Subscription) -> Rule:
        """The rule for a path: of the operators, else of the subscription, else any change."""
        return self.own_rule(path) or rule_for(path, subscription.rules)

    def plan(
        self,
        subscription: Subscription,
        held: Mapping[str, Feed],
        newest: Mapping[str, TreeItem],
        sender: Sender | None = None,
        *,
        over_wire: bool = False,
    ) -> SubscriptionPlan:
        """The plan for a subscription; feeds that are held continue, new ones begin with the newest value.

        `over_wire`: of another computer of this platform, to which all values are notified. Resources to
        which `sender` may not subscribe are left out, as if they did not exist.
        """
        permits = self._access.permits
        matched = [
            leaf for leaf in self._match(subscription) if permits(sender, Verb.SUBSCRIBE, leaf.resource.path)
        ]
        feeds: dict[str, Feed] = {}
        # boards first: each has one value, a stream may fill a notification alone
        for item in sorted(matched, key=lambda item: item.resource.kind not in LATEST_ONLY):
            resource = item.resource
            if resource.link == "tick" and not over_wire:
                continue
            rule = self.rule(resource.path, subscription)
            feed = held.get(resource.path)
            # an unchanged feed continues: its queue and its last value would be lost otherwise
            if feed is None or feed.resource != resource or feed.rule != rule:
                feed = Feed(resource, rule, self._min_interval_ns, over_wire=over_wire)
                value = newest.get(resource.path)
                # events of the past are not for a new subscriber; the newest value of a board is
                if value is not None and feed.latest_only:
                    feed.offer(value)
            feeds[resource.path] = feed
        in_beacons = () if over_wire else (one.resource for one in matched if one.resource.link == "tick")
        return SubscriptionPlan(tuple(in_beacons), feeds)

    def limit(self, plan: SubscriptionPlan, platform: str) -> tuple[BoardLimit, ...]:
        """Apply the rules in force to the feeds of a plan; returns the limits that hold for its boards.

        `platform`: the subscriber, at the other end of the link.
        """
        for path, feed in plan.feeds.items():
            feed.set_channel(self.settings(path, platform))
        beacons = {resource.path for resource in plan.beacon_boards}
        paths = plan.board_paths
        # exact paths come first: a pattern of `channels.toml` would hide the rule that precedes it
        found = [
            limit
            for path in paths
            if (limit := self._rule_limit(path, "" if path in beacons else platform)) is not None
        ]
        for rule in self._limits:
            max_hz = rule.settings.max_hz
            if max_hz is not None and any(
                rule.matches(path, "" if path in beacons else platform) for path in paths
            ):
                found.append(BoardLimit(rule.pattern, max_hz))
        return tuple(found[:BOARD_LIMITS_LIMIT])

    def settings(self, path: str, platform: str) -> ChannelSettings:
        """The settings in force of a resource on the way to a subscriber."""
        found = settings_of(self._limits, path, platform)
        if found.max_hz is not None and self._rate_rule(path, platform) is None:
            return msgspec.structs.replace(found, max_hz=None, adaptive=None)
        return found

    def rate(
        self, resource: Resource, subscription: Subscription, platform: str, *, over_wire: bool = False
    ) -> ChannelRate:
        """The rate in force of a resource on the way to a subscriber, and where it was set.

        `platform`: empty for a board in the beacons, which go to all.
        """
        path, own = resource.path, self._own
        if (channel := self._rate_rule(path, platform)) is not None:
            source = RateSource.FILE if channel.from_file else RateSource.OPERATOR
            max_hz = channel.settings.max_hz
            limit_hz = None if max_hz == RATE_MAX_HZ else max_hz
            return ChannelRate(source, limit_hz, own, channel.pattern, channel.link)
        rule = self.own_rule(path)
        if rule is not None and rule.min_interval_s > 0:
            return ChannelRate(RateSource.NOTIFICATION_RULE, 1 / rule.min_interval_s, own, rule.pattern)
        wanted = first_rule(path, subscription.rules) if rule is None else None
        if wanted is not None and wanted.min_interval_s > 0:
            return ChannelRate(RateSource.SUBSCRIBER, 1 / wanted.min_interval_s, platform, wanted.pattern)
        if resource.link == "tick" and not over_wire:
            if resource.rate_hz > 0:
                return ChannelRate(RateSource.RESOURCE, resource.rate_hz, own)
            return ChannelRate(RateSource.BEACON, None, own)
        if resource.kind not in LATEST_ONLY:
            return ChannelRate(platform=own)
        half_ns, default_ns = half_period_ns(resource), 0 if over_wire else self._min_interval_ns
        if not half_ns and not default_ns:
            return ChannelRate(platform=own)
        source = RateSource.RESOURCE if half_ns >= default_ns else RateSource.DEFAULT
        return ChannelRate(source, 1e9 / max(half_ns, default_ns), own)

    def _rate_rule(self, path: str, platform: str) -> ChannelLimit | None:
        """The rule of channels that sets the rate, or None; words of operators precede the file."""
        found = rate_rule(self._limits, path, platform)
        is_ruled = found is not None and found.from_file and self.has_interval(path)
        return None if is_ruled else found

    def has_interval(self, path: str) -> bool:
        """Whether an operator's notification rule sets the interval of a path."""
        rule = self.own_rule(path)
        return rule is not None and rule.min_interval_s > 0

    def _rule_limit(self, path: str, platform: str) -> BoardLimit | None:
        """The minimum interval of the operators' rule: subscribers know by it what age to expect."""
        rule = self.own_rule(path)
        if rule is None or rule.min_interval_s <= 0 or self._rate_rule(path, platform) is not None:
            return None
        return BoardLimit(path, 1 / rule.min_interval_s)

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
