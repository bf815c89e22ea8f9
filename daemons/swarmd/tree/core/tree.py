"""The swarm's tree as one platform holds it: its own, the others', the subscriptions between them."""

from collections.abc import Iterable

import msgspec

from swarmd.tree.core.action import Action
from swarmd.tree.core.held import Held, Intervals
from swarmd.tree.core.interest import Interests
from swarmd.tree.core.local import LocalTree, Timing
from swarmd.tree.core.remotes import Remotes, ReplicaTimeouts
from swarmware.resource import Resource
from swarmware.types.tree import (
    Rule,
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeItem,
    TreeNotify,
)


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """All times of the core."""

    timing: Timing
    intervals: Intervals
    timeouts: ReplicaTimeouts


class SwarmTree:
    """Feed it with what happens; after each call carry out what `drain` gives."""

    def __init__(
        self,
        platform: str,
        template: Iterable[Resource],
        *,
        epoch: int,
        limits: Limits,
        templates: Iterable[Iterable[Resource]] = (),
        rules: Iterable[Rule] = (),
        keep: Iterable[str] = (),
    ) -> None:
        """`epoch`: another number at each start. `templates`: that both sides can be expected to know."""
        self._actions: list[Action] = []
        emit = self._actions.append
        template = tuple(template)
        self.platform = platform
        self.local = LocalTree(template, epoch, limits.timing)
        self.interests = Interests(platform, rules, keep)
        self.held = Held(platform, self.local, limits.intervals, emit)
        self.remotes = Remotes(
            self.local, platform, self.interests, (template, *templates), limits.timeouts, emit
        )
        self._planned: tuple[int, int, int] | None = None

    def drain(self) -> list[Action]:
        """What is to be done now, in this order."""
        if not self._actions:
            return []
        actions = self._actions[:]
        self._actions.clear()
        return actions

    # -- this platform

    def set_applications(self, provided: Iterable[Resource], patterns: Iterable[str], now_ns: int) -> None:
        """What the running applications provide and what they want to read."""
        if self.local.set_live(provided, now_ns):
            self.held.on_structure(now_ns)
        if self.interests.set_patterns(patterns):
            self.remotes.on_interests()

    def on_value(self, item: TreeItem, now_ns: int) -> None:
        """A value of a resource that is watched."""
        self.held.on_value(item, now_ns)

    # -- the network

    def on_up(self, platform: str, version: int | None, near: bool, now_ns: int) -> None:
        """A platform can be reached, or the version of its tree or its being near has changed."""
        self.remotes.on_up(platform, version, near, now_ns)
        self.held.on_up(platform, now_ns)

    def on_gone(self, platform: str, now_ns: int) -> None:
        """It cannot be reached any more."""
        self.remotes.on_gone(platform, now_ns)
        self.held.on_gone(platform, now_ns)

    def on_structure_asked(self, request: StructureRequest) -> StructureReply:
        """Another tree asks for our structure."""
        self.remotes.on_asked_by(request.platform, request.epoch, request.digest)
        self.held.on_told(request.platform)
        return self.local.answer(request)

    def on_subscribe_asked(self, request: SubscribeRequest, now_ns: int) -> SubscribeReply:
        """Another tree subscribes here, or renews. Raises: InvalidInput."""
        self.remotes.on_asked_by(request.platform, request.epoch, None)
        return self.held.on_asked(request, now_ns)

    def on_structure(self, platform: str, reply: StructureReply | None, now_ns: int) -> None:
        """Answer to `AskStructure`; None: there was none."""
        self.remotes.on_structure(platform, reply, now_ns)

    def on_subscribed(self, platform: str, reply: SubscribeReply | None, asked: int, now_ns: int) -> None:
        """Answer to `AskSubscription` with the set digest `asked`; None: there was none."""
        self.remotes.on_subscribed(platform, reply, asked, now_ns)

    def on_notify(self, notify: TreeNotify, now_ns: int) -> list[TreeItem]:
        """A notification came; the values that are for mirrors."""
        return self.remotes.on_notify(notify, now_ns)

    def on_notified(self, platform: str, notify: TreeNotify, delivered: bool, now_ns: int) -> None:
        """What became of `SendNotify`."""
        self.held.on_notified(platform, notify, delivered, now_ns)

    # -- time

    def on_timer(self, now_ns: int) -> None:
        """Call it at `deadline_ns`."""
        if self.local.on_timer(now_ns):
            self.held.on_structure(now_ns)
        self.remotes.on_timer(now_ns)
        self.held.on_timer(now_ns)

    def deadline_ns(self) -> int | None:
        """When `on_timer` must be called; None: not before something happens."""
        soonest = self.local.deadline_ns()
        for when in (self.remotes.deadline_ns(), self.held.deadline_ns()):
            if when is not None and (soonest is None or when < soonest):
                soonest = when
        return soonest

    # -- for the broker

    def plan_changed(self) -> bool:
        """Whether the tick must carry something else than when this was asked last."""
        now = (self.local.version, self.held.plan_count, self.remotes.plan_count)
        before, self._planned = self._planned, now
        return before != now
