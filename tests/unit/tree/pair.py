"""Two tree cores and the messages between them, carried by hand."""

from collections.abc import Callable
from typing import Any

import msgspec

from swarmd.tree.config import Config, RuleConfig
from swarmd.tree.core.action import Action, RequestStructure, RequestSubscription, SendNotify, WriteMirror
from swarmd.tree.core.tree import SwarmTree
from swarmware.model.frame import FrameKind
from swarmware.model.resource import Kind, Resource
from swarmware.types.tree_exchange import TreeItem, TreeNotify

S = 1_000_000_000
CONFIG = Config(
    lost_s=1.0,
    expire_s=10.0,
    coalesce_s=0.2,
    min_interval_s=0.0,
    lease_s=60.0,
    retry_s=(1.0, 2.0),
    forget_s=600.0,
)
BATTERY = Resource(path="power/battery", type="Float", owner="hal")
FAULTS = Resource(path="health/faults", kind=Kind.EVENT, type="Text", owner="health")
POSE = Resource(path="nav/pose", type="Pose", rate_hz=20.0, owner="navigator")
STEP = Resource(path="plan/step", type="Text", owner="planner")
TEMPLATE = (FAULTS, POSE, BATTERY)


class Tree:
    """A core whose actions are kept until they are asked for."""

    def __init__(self, core: SwarmTree) -> None:
        self.core = core
        self._actions: list[Action] = []

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.core, name)
        return self._keep(found) if name.startswith("on_") else found

    def _keep(self, event: Callable[..., Any]) -> Callable[..., Any]:
        def call(*facts: Any) -> Any:
            found = event(*facts)
            answer, actions = found if isinstance(found, tuple) else (None, found)
            self._actions += actions
            return answer

        return call

    def on_notify(self, notify: TreeNotify, now_ns: int) -> list[TreeItem]:
        """The values for mirrors."""
        found: list[TreeItem] = []
        for action in self.core.on_notify(notify, now_ns):
            if isinstance(action, WriteMirror):
                assert action.platform == notify.platform
                found.append(action.item)
            else:
                self._actions.append(action)
        return found

    def drain(self) -> list[Action]:
        """What is to be done since the last time."""
        actions, self._actions = self._actions, []
        return actions


def core(
    name: str,
    template: tuple[Resource, ...] = TEMPLATE,
    *,
    epoch: int = 1,
    templates: tuple[tuple[Resource, ...], ...] = (TEMPLATE,),
    rules: tuple[RuleConfig, ...] = (),
    config: Config = CONFIG,
) -> Tree:
    config = msgspec.structs.replace(config, rules=rules)
    return Tree(SwarmTree(name, template, config, epoch=epoch, templates=templates))


def value(path: str, number: float, sequence: int = 1, kind: FrameKind = FrameKind.BOARD) -> TreeItem:
    return TreeItem(path, 7, kind, sequence, sequence, msgspec.msgpack.encode([number]))


class Pair:
    """`a` and `b`, each with what it wants done; messages move when `carry` is called."""

    def __init__(self, a: Tree, b: Tree) -> None:
        self.trees = {a.platform: a, b.platform: b}
        self.now_ns = 0
        self.log: list[tuple[str, Action]] = []
        self.received: dict[str, list[TreeItem]] = {a.platform: [], b.platform: []}

    def replace(self, fresh: Tree) -> None:
        """A tree service that started again."""
        self.trees[fresh.platform] = fresh

    def meet(self, *, near: bool = True) -> None:
        """Each can reach the other."""
        one, other = self.trees.values()
        one.on_up(other.platform, other.local.version, near, self.now_ns)
        other.on_up(one.platform, one.local.version, near, self.now_ns)

    def wait(self, seconds: float) -> None:
        """Time passes; timers fire at their deadlines, messages are carried."""
        end_ns = self.now_ns + round(seconds * S)
        self.carry()
        while True:
            deadlines = [when for tree in self.trees.values() if (when := tree.deadline_ns()) is not None]
            if not deadlines or min(deadlines) > end_ns:
                break
            self.now_ns = max(self.now_ns, min(deadlines))
            for tree in self.trees.values():
                tree.on_timer(self.now_ns)
            self.carry()
        self.now_ns = end_ns

    def carry(self, *, lose: bool = False, lose_answers: bool = False) -> int:
        """Delivers all messages until none is pending; returns their number."""
        count = 0
        while True:
            pending = [(name, action) for name, tree in self.trees.items() for action in tree.drain()]
            if not pending:
                return count
            for name, action in pending:
                self.log.append((name, action))
                count += 1
                self._carry(self.trees[name], action, lose, lose_answers)

    def _carry(self, tree: Tree, action: Action, lose: bool, lose_answers: bool) -> None:
        now_ns = self.now_ns
        match action:
            case RequestStructure(platform, request):
                structure = None if lose else self.trees[platform].on_structure_asked(request, now_ns)
                tree.on_structure(platform, None if lose_answers else structure, now_ns)
            case RequestSubscription(platform, subscribe):
                granted = None if lose else self.trees[platform].on_subscribe_asked(subscribe, None, now_ns)
                tree.on_subscribed(platform, None if lose_answers else granted, subscribe.set_digest, now_ns)
            case SendNotify(platform, notify):
                if not lose:
                    self.hear(platform, notify)
                tree.on_notified(platform, notify, not (lose or lose_answers), now_ns)

    def hear(self, platform: str, notify: TreeNotify) -> None:
        """A notification arrives."""
        self.received[platform] += self.trees[platform].on_notify(notify, self.now_ns)

    def said(self, kind: type[Action]) -> int:
        """Messages of a kind so far."""
        return sum(isinstance(action, kind) for _, action in self.log)

    def last(self, name: str, kind: type[Action]) -> Action:
        """The newest message of that kind from one side."""
        return next(action for who, action in reversed(self.log) if who == name and isinstance(action, kind))


def pair(*patterns: str, near: bool = True) -> Pair:
    """gcs reads the patterns; they have met and everything is settled."""
    both = Pair(core("gcs"), core("uav1"))
    both.trees["gcs"].on_applications([], patterns, 0)
    both.meet(near=near)
    both.carry()
    return both
