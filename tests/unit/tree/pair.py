"""Two tree cores and the messages between them, carried by hand."""

import msgspec

from swarmd.tree.core.action import Action, AskStructure, AskSubscription, SendNotify
from swarmd.tree.core.held import Intervals
from swarmd.tree.core.local import Timing
from swarmd.tree.core.remotes import ReplicaTimeouts
from swarmd.tree.core.tree import Limits, SwarmTree
from swarmware.frame import Kind as FrameKind
from swarmware.resource import Kind, Resource
from swarmware.types.tree import Rule, TreeItem, TreeNotify

S = 1_000_000_000
LIMITS = Limits(
    timing=Timing(lost_ns=1 * S, expire_ns=10 * S),
    intervals=Intervals(coalesce_ns=S // 5, min_interval_ns=0, retry_ns=(1 * S, 2 * S)),
    timeouts=ReplicaTimeouts(lease_ns=60 * S, retry_ns=(1 * S, 2 * S), forget_ns=600 * S),
)
BATTERY = Resource(path="power/battery", type="Float", owner="hal")
FAULTS = Resource(path="health/faults", kind=Kind.EVENT, type="Text", owner="health")
POSE = Resource(path="nav/pose", type="Pose", rate_hz=20.0, owner="navigator")
STEP = Resource(path="plan/step", type="Text", owner="planner")
TEMPLATE = (FAULTS, POSE, BATTERY)


def core(
    name: str,
    template: tuple[Resource, ...] = TEMPLATE,
    *,
    epoch: int = 1,
    templates: tuple[tuple[Resource, ...], ...] = (TEMPLATE,),
    rules: tuple[Rule, ...] = (),
    limits: Limits = LIMITS,
) -> SwarmTree:
    return SwarmTree(name, template, epoch=epoch, limits=limits, templates=templates, rules=rules)


def value(path: str, number: float, sequence: int = 1, kind: FrameKind = FrameKind.BOARD) -> TreeItem:
    return TreeItem(path, 7, kind, sequence, sequence, msgspec.msgpack.encode([number]))


class Pair:
    """`a` and `b`, each with what it wants done; messages move when `carry` is called."""

    def __init__(self, a: SwarmTree, b: SwarmTree) -> None:
        self.trees = {a.platform: a, b.platform: b}
        self.now_ns = 0
        self.log: list[tuple[str, Action]] = []
        self.received: dict[str, list[TreeItem]] = {a.platform: [], b.platform: []}

    def replace(self, fresh: SwarmTree) -> None:
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
        """All messages, until nobody has anything to say; how many."""
        count = 0
        while True:
            pending = [(name, action) for name, tree in self.trees.items() for action in tree.drain()]
            if not pending:
                return count
            for name, action in pending:
                self.log.append((name, action))
                count += 1
                self._carry(self.trees[name], action, lose, lose_answers)

    def _carry(self, tree: SwarmTree, action: Action, lose: bool, lose_answers: bool) -> None:
        now_ns = self.now_ns
        match action:
            case AskStructure(platform, request):
                structure = None if lose else self.trees[platform].on_structure_asked(request)
                tree.on_structure(platform, None if lose_answers else structure, now_ns)
            case AskSubscription(platform, wish):
                granted = None if lose else self.trees[platform].on_subscribe_asked(wish, now_ns)
                tree.on_subscribed(platform, None if lose_answers else granted, wish.set_digest, now_ns)
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
    both.trees["gcs"].set_applications([], patterns, 0)
    both.meet(near=near)
    both.carry()
    return both
