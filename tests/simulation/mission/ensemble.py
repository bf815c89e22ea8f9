"""An ensemble in virtual time: real mission cores, lossy broadcasts, clocks that differ, faults."""

import heapq
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from random import Random
from typing import Any

import msgspec

from swarmd.mission.config import Config
from swarmd.mission.core.barrier import lead_ns
from swarmd.mission.core.executor import START
from swarmd.mission.core.run import Action, Announce, CancelBlock, ProgressStep, Run, StartBlock
from swarmd.mission.core.scheduler import MissionScheduler
from swarmware.errors import Conflict
from swarmware.mission.binding import Binding
from swarmware.mission.field_path import Scalar
from swarmware.mission.loader import load
from swarmware.mission.model import Block, MissionDefinition
from swarmware.mission.outcome import SUCCESS, BlockOutcome, OutcomeKind
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import BarrierResult, Member, MissionState

S = 1_000_000_000
CANCELLED = BlockOutcome(OutcomeKind.CANCELLED)
BUILT_IN = {
    name: load(
        '{"mission": {"s": {"type": "Start", "next": "b"}, '
        f'"b": {{"type": "{name.title()}", "next": "e"}}, "e": {{"type": "End"}}}}}}',
        name,
        Binding(),
    )
    for name in ("land", "hold")
}
FINAL = {"done", "failed", "aborted"}


class Nothing:
    """A vehicle of which nothing is known."""

    def value(self, path: str, field: str) -> Scalar | None:
        return None

    def age_s(self, path: str) -> float | None:
        return None


class World(msgspec.Struct, frozen=True):
    """How bad it is."""

    loss: float = 0.1
    """Of each datagram at each receiver."""
    delay_ms: tuple[float, float] = (1.0, 60.0)
    beacon_hz: float = 10.0
    """Rate of the links as the members know it."""
    conversion_error_us: float = 100.0
    block_s: tuple[float, float] = (0.2, 3.0)
    fail: float = 0.0
    """Share of blocks that end with an error."""
    hang: float = 0.0
    """Share of blocks that end only when cancelled; a tenth of them not even then."""


class Passage(msgspec.Struct, frozen=True):
    """A member has left a barrier."""

    member: str
    block: str
    outcome: str
    at_ns: int
    """True time."""


class Node:
    """A member with a clock of its own."""

    def __init__(self, member: Member, chance: Random, beacon_hz: float) -> None:
        self.name = member.platform
        built_in = {} if member.kind == "gcs" else BUILT_IN
        self.core = MissionScheduler(
            member.platform,
            built_in,
            Nothing(),
            chance.random,
            Config(),
            lambda _: lead_ns(S // 4, beacon_hz, 1),
        )
        self.offset_ns = round(chance.uniform(-5, 5) * S)
        self.rate = 1 + chance.uniform(-50e-6, 50e-6)
        self.alive = True
        self.running: dict[int, tuple[Block, bool]] = {}
        """Blocks by token, and whether they listen to a cancel."""
        self.landed = False
        self.wake_ns: int | None = None

    @property
    def is_over(self) -> bool:
        """Whether it plays nothing, and nothing waits."""
        return self.core.phase.value in FINAL and self.core.is_idle

    def now(self, true_ns: int) -> int:
        return round(true_ns * self.rate) + self.offset_ns

    def true(self, own_ns: int) -> int:
        return round((own_ns - self.offset_ns) / self.rate)


class Ensemble:
    """Runs members in virtual time; the same seed, the same run."""

    def __init__(self, members: tuple[Member, ...], seed: int, world: World) -> None:
        self.members = members
        self.world = world
        self.chance = Random(seed)
        self.nodes = {m.platform: Node(m, self.chance, world.beacon_hz) for m in members}
        self.now_ns = S
        self.passages: list[Passage] = []
        self.cut_off: set[str] = set()
        """Members without reception in either direction."""
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()

    def at(self, true_ns: int, do: Callable[[], None]) -> None:
        heapq.heappush(self._events, (max(true_ns, self.now_ns), next(self._order), do))

    def run(self, until_s: float) -> None:
        """Runs until no member plays a mission, or for this time."""
        for node in self.nodes.values():
            self._after(node, node.core.on_timer(node.now(self.now_ns)))  # announces that it is idle
        self.at(self.now_ns + S, self._signs_of_life)
        while self._events and self._events[0][0] <= until_s * S:
            self.now_ns, _, do = heapq.heappop(self._events)
            do()
            if all(not n.alive or n.is_over for n in self.nodes.values()):
                return

    def order(
        self,
        name: str,
        mission: MissionDefinition,
        epoch: int = 1,
        priority: int = 0,
        members: tuple[Member, ...] = (),
    ) -> None:
        """The order reaches a member now, unless that is down; it may refuse it."""
        node = self.nodes[name]
        role = next(m.role for m in self.members if m.platform == name)
        run = Run(mission, "trial", "00112233", epoch, role, members or self.members, priority=priority)
        if node.alive:
            with suppress(Conflict):
                self._after(node, node.core.on_order(run, node.now(self.now_ns)))

    def kill(self, name: str) -> None:
        self.nodes[name].alive = False

    def abort(self, name: str) -> None:
        node = self.nodes[name]
        self._after(node, node.core.on_abort("operator", "land", node.now(self.now_ns)))

    def outcomes(self) -> dict[str, str]:
        return {name: node.core.phase.value for name, node in self.nodes.items() if node.alive}

    def spreads_ns(self) -> dict[str, int]:
        """Of each barrier that opened: from the first to the last who left it."""
        times: dict[str, list[int]] = {}
        for passage in self.passages:
            if passage.outcome == "ok":
                times.setdefault(passage.block, []).append(passage.at_ns)
        return {block: max(found) - min(found) for block, found in times.items()}

    def _apart(self, one: Node, other: Node) -> bool:
        return one is other or bool(self.cut_off & {one.name, other.name})

    def _signs_of_life(self) -> None:
        """Once a second: whose beacons (ten a second) were heard."""
        for node in self.nodes.values():
            for other in self.nodes.values():
                if self._apart(node, other):
                    continue
                if other.alive and self.chance.random() >= self.world.loss**10:
                    node.core.on_alive(other.name, node.now(self.now_ns))
        self.at(self.now_ns + S, self._signs_of_life)

    def _after(self, node: Node, actions: list[Action]) -> None:
        """What the shell does after each call of its core."""
        for action in actions:
            match action:
                case StartBlock(token, block):
                    self._begin(node, token, block)
                case CancelBlock(token):
                    if node.running.get(token, (None, False))[1]:
                        self.at(self.now_ns + S // 50, lambda t=token: self._ended(node, t, CANCELLED))  # type: ignore[misc]  # the default binds the value now
                case ProgressStep(block, "Barrier", outcome) if outcome != "started":
                    self.passages.append(Passage(node.name, block, outcome, self.now_ns))
                case ProgressStep("", _, "state:running"):
                    self.passages.append(Passage(node.name, START, "ok", self.now_ns))
                case Announce(state):
                    self._broadcast(node, state)
        wake = node.core.deadline_ns()
        true_ns = max(node.true(wake), self.now_ns)
        while node.now(true_ns) < wake:
            true_ns += 1
        if node.wake_ns is None or true_ns < node.wake_ns or node.wake_ns <= self.now_ns:
            node.wake_ns = true_ns
            self.at(true_ns, lambda: self._wake(node, true_ns))

    def _wake(self, node: Node, due_ns: int) -> None:
        if node.alive and node.wake_ns == due_ns:
            node.wake_ns = None
            self._after(node, node.core.on_timer(node.now(self.now_ns)))

    def _broadcast(self, node: Node, state: MissionState) -> None:
        for other in self.nodes.values():
            if self._apart(node, other):
                continue
            if self.chance.random() >= self.world.loss:
                delay = self.chance.uniform(*self.world.delay_ms)
                self.at(self.now_ns + round(delay * 1e6), lambda o=other: self._hear(o, node, state))  # type: ignore[misc]  # as above

    def _hear(self, node: Node, sender: Node, state: MissionState) -> None:
        if not node.alive:
            return
        error = self.world.conversion_error_us * 1000
        meetings = tuple(
            BarrierResult(
                m.barrier,
                m.visit,
                None
                if m.leave_ns is None
                else node.now(sender.true(m.leave_ns)) + round(self.chance.uniform(-error, error)),
                m.by,
            )
            for m in state.meetings
        )
        self._after(node, node.core.on_states([(sender.name, state, meetings)], node.now(self.now_ns)))

    def _begin(self, node: Node, token: int, block: Block) -> None:
        landing = block.type in {"Land", "Hold"}
        listens = self.chance.random() >= 0.1
        if not landing and self.chance.random() < self.world.hang:
            node.running[token] = (block, listens)
            return
        node.running[token] = (block, True)
        fails = not landing and self.chance.random() < self.world.fail
        result = BlockOutcome(OutcomeKind.ERROR, block.spec.errors[0]) if fails else SUCCESS
        seconds = self.chance.uniform(*self.world.block_s)
        self.at(self.now_ns + round(seconds * S), lambda: self._ended(node, token, result))

    def _ended(self, node: Node, token: int, result: BlockOutcome) -> None:
        if not node.alive or token not in node.running:
            return
        block, _ = node.running.pop(token)
        node.landed = result == SUCCESS and block.type in {"Land", "Hold"}
        self._after(node, node.core.on_ended(token, result, "", node.now(self.now_ns)))


def swarm(ground: int, air: int) -> tuple[Member, ...]:
    """Members in the order in which the formation mission has them."""
    return (
        *(Member(f"ugv{n}", "ground", PlatformKind.UGV) for n in range(1, ground + 1)),
        *(Member(f"uav{n}", "air", PlatformKind.UAV) for n in range(1, air + 1)),
        Member("gcs", "control", PlatformKind.GCS),
    )


def bind(text: str, member: Member) -> MissionDefinition:
    """The member's own copy of a mission."""
    return load(text, "trial.json", Binding(member.platform, member.kind, member.role, "trial"))


def blocks(**bodies: Any) -> str:
    """A mission's text."""
    return msgspec.json.encode({"mission": bodies}).decode()
