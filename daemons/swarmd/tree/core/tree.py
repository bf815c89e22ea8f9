"""The swarm's tree as one platform holds it: its own, the others', the subscriptions between them."""

from collections.abc import Iterable

from swarmd.tree.config import Config
from swarmd.tree.core.action import Action, WriteMirror
from swarmd.tree.core.held import Held, Intervals
from swarmd.tree.core.interest import Interests
from swarmd.tree.core.local import LocalTree, Timing
from swarmd.tree.core.remotes import Remotes, ReplicaTimeouts
from swarmware.resource import Resource
from swarmware.types.net import ChannelLimit
from swarmware.types.tree import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeItem,
    TreeNotify,
)


class SwarmTree:
    """Everything the tree of one platform knows."""

    def __init__(
        self,
        platform: str,
        template: Iterable[Resource],
        config: Config,
        *,
        epoch: int,
        templates: Iterable[Iterable[Resource]] = (),
        keep: Iterable[str] = (),
    ) -> None:
        """`epoch`: another number at each start. `templates`: that both sides can be expected to know."""
        self._actions: list[Action] = []
        emit = self._actions.append
        template = tuple(template)
        self.platform = platform
        retry_ns = tuple(_ns(pause_s) for pause_s in config.retry_s)
        self.local = LocalTree(
            template, epoch, Timing(lost_ns=_ns(config.lost_s), expire_ns=_ns(config.expire_s))
        )
        self.interests = Interests(platform, [rule.rule() for rule in config.rules], keep)
        intervals = Intervals(
            coalesce_ns=_ns(config.coalesce_s),
            min_interval_ns=_ns(config.min_interval_s),
            retry_ns=retry_ns,
        )
        self.held = Held(platform, self.local, intervals, emit)
        timeouts = ReplicaTimeouts(
            lease_ns=_ns(config.lease_s),
            retry_ns=retry_ns,
            forget_ns=_ns(config.forget_s),
            whole_swarm=config.whole_swarm,
        )
        self.remotes = Remotes(self.local, platform, self.interests, (template, *templates), timeouts, emit)
        self._planned: tuple[int, int, int] | None = None

    def _done(self) -> list[Action]:
        """What is to be done after one event, in this order."""
        actions = self._actions[:]
        self._actions.clear()
        return actions

    # -- this platform

    def on_applications(
        self, provided: Iterable[Resource], patterns: Iterable[str], now_ns: int
    ) -> list[Action]:
        """What the running applications provide and what they want to read."""
        if self.local.set_live(provided, now_ns):
            self.held.on_structure(now_ns)
        if self.interests.set_patterns(patterns):
            self.remotes.on_interests()
        return self._done()

    def on_value(self, item: TreeItem, now_ns: int) -> list[Action]:
        """A value of a resource that is watched."""
        self.held.on_value(item, now_ns)
        return self._done()

    def on_limits(self, limits: tuple[ChannelLimit, ...], now_ns: int) -> list[Action]:
        """What operators set for the rates of resources."""
        self.held.set_limits(limits, now_ns)
        return self._done()

    def on_demand(self, platform: str, now_ns: int) -> list[Action]:
        """Somebody wants to see the structure of another platform; it may become known: `remotes.asks`."""
        self.remotes.demand(platform)
        return self._done()

    # -- the network

    def on_left_behind(self, platform: str, now_ns: int) -> list[Action]:
        """There are mirrors of it from a former start: it is forgotten like any that went away."""
        self.remotes.on_left_behind(platform, now_ns)
        return self._done()

    def on_up(self, platform: str, version: int | None, near: bool, now_ns: int) -> list[Action]:
        """A platform can be reached, or the version of its tree or its being near has changed."""
        self.remotes.on_up(platform, version, near, now_ns)
        self.held.on_up(platform, now_ns)
        return self._done()

    def on_gone(self, platform: str, now_ns: int) -> list[Action]:
        """It cannot be reached any more."""
        self.remotes.on_gone(platform, now_ns)
        self.held.on_gone(platform, now_ns)
        return self._done()

    def on_structure_asked(
        self, request: StructureRequest, now_ns: int
    ) -> tuple[StructureReply, list[Action]]:
        """Another tree asks for our structure."""
        self.remotes.on_asked_by(request.platform, request.epoch, request.digest)
        self.held.on_told(request.platform)
        return self.local.answer(request), self._done()

    def on_subscribe_asked(
        self, request: SubscribeRequest, now_ns: int
    ) -> tuple[SubscribeReply, list[Action]]:
        """Another tree subscribes here, or renews. Raises: InvalidInput."""
        self.remotes.on_asked_by(request.platform, request.epoch, None)
        return self.held.on_asked(request, now_ns), self._done()

    def on_structure(self, platform: str, reply: StructureReply | None, now_ns: int) -> list[Action]:
        """Answer to `AskStructure`; None: there was none."""
        self.remotes.on_structure(platform, reply, now_ns)
        return self._done()

    def on_subscribed(
        self, platform: str, reply: SubscribeReply | None, asked: int, now_ns: int
    ) -> list[Action]:
        """Answer to `AskSubscription` with the set digest `asked`; None: there was none."""
        self.remotes.on_subscribed(platform, reply, asked, now_ns)
        return self._done()

    def on_notify(self, notify: TreeNotify, now_ns: int) -> list[Action]:
        """A notification came."""
        items = self.remotes.on_notify(notify, now_ns)
        return [*(WriteMirror(notify.platform, item) for item in items), *self._done()]

    def on_notified(self, platform: str, notify: TreeNotify, delivered: bool, now_ns: int) -> list[Action]:
        """What became of `SendNotify`."""
        self.held.on_notified(platform, notify, delivered, now_ns)
        return self._done()

    # -- time

    def on_timer(self, now_ns: int) -> list[Action]:
        """What is due: leases, retries, owners that have been away."""
        if self.local.on_timer(now_ns):
            self.held.on_structure(now_ns)
        self.remotes.on_timer(now_ns)
        self.held.on_timer(now_ns)
        return self._done()

    def deadline_ns(self) -> int | None:
        """When `on_timer` must be called; None: not before something happens."""
        soonest = self.local.deadline_ns()
        for when in (self.remotes.deadline_ns(), self.held.deadline_ns()):
            if when is not None and (soonest is None or when < soonest):
                soonest = when
        return soonest

    # -- for the broker

    def plan_changed(self) -> bool:
        """Whether the beacon must carry something else than when this was asked last."""
        now = (self.local.version, self.held.plan_count, self.remotes.plan_count)
        before, self._planned = self._planned, now
        return before != now


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
