"""A swarm of real tree cores in virtual time: moving radios, loss, late and doubled answers, crashes."""

import random
from collections.abc import Callable, Iterable
from functools import lru_cache, partial
from typing import TypeVar

import msgspec
from tests.simulation.tree.beacons import BeaconAir
from tests.simulation.tree.node import Node
from tests.simulation.tree.radio import Radio

from swarmd.tree.core.action import Action
from swarmd.tree.core.structure.subscription import subscribable
from swarmd.tree.core.tree import SwarmTree
from swarmware.model.frame import FrameKind
from swarmware.model.names import Address
from swarmware.testing.virtual import VirtualTime
from swarmware.types.tree_exchange import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeNotify,
)

Answer = TypeVar("Answer")

GIVE_UP_S = 2.0
"""Time after which a request without an answer is given up."""
HOP_S = (0.002, 0.1)


class Weather(msgspec.Struct, frozen=True):
    """What a run is like."""

    nodes: int = 100
    field_m: float = 2200.0
    """Side of the square for 100 nodes; others have one of the same density."""
    radio_m: float = 350.0
    speed_m_s: float = 8.0
    loss: float = 0.15
    """Share of messages that are given up although there was a way."""
    half: float = 0.05
    """Share whose acknowledgement or answer is lost: it did happen, the sender does not know."""
    late: float = 0.03
    """Share of notifications that arrive seconds after they were given up."""
    crashes: int = 6
    """Nodes that die; some come back, at once or after a while."""
    tree_restarts: int = 6
    """Tree services that start again while their node goes on."""
    new_modules: int = 10
    values: int = 60
    storm_s: float = 20.0
    """How long all this goes on."""
    calm_s: float = 30.0
    """How long the swarm has to come to rest: links stay lossy, radios stand still."""
    whole_swarm: bool = False


@lru_cache(maxsize=256)
def _notified(tree: SwarmTree, digest: int, patterns: tuple[str, ...]) -> frozenset[str]:
    """Paths whose values somebody with these patterns must be told."""
    del digest  # part of the key: the answer holds for one structure
    return frozenset(
        item.resource.path
        for item in tree.local.index
        if item.resource.link != "tick" and subscribable(item, patterns)
    )


class Swarm(VirtualTime):
    """Nodes, radios and chance."""

    def __init__(self, seed: int, weather: Weather) -> None:
        super().__init__()
        self.weather = weather
        self.messages = 0
        self._random = random.Random(seed)
        numbers = range(weather.nodes)
        self.nodes = {f"n{i}": Node(self, i, whole_swarm=weather.whole_swarm) for i in numbers}
        self.radio = Radio(
            self.nodes,
            self._random,
            side_m=weather.field_m * (weather.nodes / 100) ** 0.5,
            range_m=weather.radio_m,
            speed_m_s=weather.speed_m_s,
        )

        self._air = BeaconAir(self, random.Random(seed + 1), self._near, self._feed, loss=weather.loss)

    def _near(self, name: str) -> Iterable[str]:
        return self.radio.near.get(name, ())

    def _feed(self, name: str, actions: list[Action]) -> None:
        self.nodes[name].do(lambda: actions)

    def on_started(self, tree: SwarmTree) -> None:
        """The broker of the node has the plan of this tree from now on."""
        tree.on_multicast(frozenset(self.nodes), self.now_ns)
        self._air.join(tree)

    def on_settled(self, name: str) -> None:
        """The plan of the tree of a node may have changed."""
        self._air.on_settled(name)

    def on_stopped(self, name: str) -> None:
        """The broker of a node has ended."""
        self._air.leave(name)

    def new_epoch(self) -> int:
        """As a tree service draws one at its start."""
        return self._random.getrandbits(32)

    # -- who is there

    def move(self) -> None:
        """Two seconds of driving."""
        self.radio.move(2.0)
        self.look()

    def look(self) -> None:
        """Who hears whom; the news of it spreads."""
        alive = [name for name, node in self.nodes.items() if node.tree is not None]
        self.radio.look(alive)
        versions: dict[int, dict[str, int]] = {}
        for name, part in self.radio.part.items():
            tree = self.nodes[name].tree
            if tree is not None:
                versions.setdefault(part, {})[name] = tree.local.version
        for name in alive:
            self._news(self.nodes[name], versions[self.radio.part[name]])

    def _news(self, node: Node, versions: dict[str, int]) -> None:
        """Tell one node, a little later, who came, went or has another tree."""
        near = self.radio.near[node.name]
        near_then, then = node.seen
        if near == near_then and versions == then:
            return
        node.seen = (near, versions)
        gone = [name for name in then if name not in versions]
        fresh = {
            name: (name in near, version)
            for name, version in versions.items()
            if name != node.name and (then.get(name) != version or (name in near) != (name in near_then))
        }
        self.after(self._random.uniform(0.05, 1.0), partial(self._tell, node, node.life, gone, fresh))

    def _tell(self, node: Node, life: int, gone: list[str], fresh: dict[str, tuple[bool, int]]) -> None:
        tree = node.tree
        if tree is None or node.life != life:
            return
        for name in gone:
            node.do(partial(tree.on_gone, name, self.now_ns))
        for name, (near, version) in fresh.items():
            # far away, the version is a rumour that may not have come yet; it is repeated until it has
            heard = near or self._random.random() < 0.5
            known = version if heard else None
            node.do(partial(tree.on_up, name, known, near, self.now_ns))
            if not heard:
                self.after(self._random.uniform(0.5, 3.0), partial(self._rumour, node, life, name))

    def _rumour(self, node: Node, life: int, name: str) -> None:
        other = self.nodes[name].tree
        if other is not None and self.radio.way(node.name, name):
            near = name in self.radio.near[node.name]
            self._tell(node, life, [], {name: (near, other.local.version)})

    # -- messages

    def ask_structure(self, one: Node, platform: str, request: StructureRequest) -> None:
        """A request to another tree."""

        def finish(reply: StructureReply | None) -> None:
            one.on_structure(platform, reply)

        self._ask(one, platform, lambda tree: tree.on_structure_asked(request, self.now_ns), finish)

    def ask_subscription(self, one: Node, platform: str, request: SubscribeRequest) -> None:
        """A request to another tree."""

        def finish(reply: SubscribeReply | None) -> None:
            one.on_subscribed(platform, reply, request.set_digest)

        self._ask(one, platform, lambda tree: tree.on_subscribe_asked(request, None, self.now_ns), finish)

    def _ask(
        self,
        one: Node,
        platform: str,
        answer: Callable[[SwarmTree], tuple[Answer, list[Action]]],
        done: Callable[[Answer | None], None],
    ) -> None:
        self.messages += 1
        life, other, luck = one.life, self.nodes[platform], self._random.random()

        def finish(reply: Answer | None) -> None:
            if one.life == life:
                done(reply)

        def arrive() -> None:
            tree = other.tree
            if tree is None or not self.radio.way(one.name, platform):
                self.after(GIVE_UP_S, partial(finish, None))
                return
            reply, actions = answer(tree)
            other.do(lambda: actions)
            if luck >= self.weather.loss:
                self.after(self._random.uniform(*HOP_S), partial(finish, reply))
            else:
                self.after(GIVE_UP_S, partial(finish, None))

        self._carry(luck, arrive, partial(finish, None))

    def _carry(self, luck: float, arrive: Callable[[], None], lost: Callable[[], None]) -> None:
        if luck < self.weather.loss - self.weather.half:
            self.after(GIVE_UP_S, lost)
        else:
            self.after(self._random.uniform(*HOP_S), arrive)

    def notify(self, one: Node, platform: str, notify: TreeNotify) -> None:
        """A message: acknowledged, or not, or not although it arrived, or it arrives when it was given up."""
        self.messages += 1
        life, luck = one.life, self._random.random()

        def finish(delivered: bool) -> None:
            if one.life == life:
                one.on_notified(platform, notify, delivered)

        def arrive() -> None:
            arrived = self._arrive(one, platform, notify)
            heard = arrived and luck >= self.weather.loss
            self.after(self._random.uniform(*HOP_S) if heard else GIVE_UP_S, partial(finish, heard))

        def straggle() -> None:
            self._arrive(one, platform, notify)

        if luck < self.weather.late:
            self.after(GIVE_UP_S, partial(finish, False))
            late_s = self._random.uniform(GIVE_UP_S, 3 * GIVE_UP_S)
            self.after(late_s, straggle)
        else:
            self._carry(luck, arrive, partial(finish, False))

    def _arrive(self, one: Node, platform: str, notify: TreeNotify) -> bool:
        other = self.nodes[platform]
        if other.tree is None or not self.radio.way(one.name, platform):
            return False
        other.receive(notify)
        return True

    # -- what happens

    def run(self) -> None:
        """The whole story: start, storm, calm."""
        rnd = self._random
        names = list(self.nodes)
        for node in self.nodes.values():
            one, two = rnd.sample(names, 2)
            node.patterns = (
                f"/{one}/power/battery",
                f"/{one}/plan/**",
                f"/{one}/nav/pose",
                f"/{two}/power/battery",
                f"/{two}/plan/**",
                f"/{two}/health/faults",
            )
            node.write("power/battery", "full")
            self.after(rnd.uniform(0, 2.0), node.start)
        self.nodes["n0"].patterns = ("/*/power/battery", "/*/mission/state", "/*/plan/*")
        self.after(2.1, self.look)
        self._storm()
        self.run_for(self.weather.storm_s + self.weather.calm_s)

    def _storm(self) -> None:
        weather = self.weather
        for _ in range(weather.crashes):
            self._crash()
        for _ in range(weather.tree_restarts):
            self.after(self._moment_s(), self._anybody().start_again)
        for number in range(weather.new_modules):
            node, at_s = self._anybody(), self._moment_s()
            self.after(at_s, partial(node.run_module, number, True))
            if number % 3 == 0:
                self.after(at_s + self._random.uniform(0.1, 8.0), partial(node.run_module, number, False))
        for number in range(weather.values):
            node = self._anybody()
            self.after(self._moment_s(), partial(node.write, "power/battery", f"{number}"))
            self.after(self._moment_s(), partial(node.write, "health/faults", "x", FrameKind.EVENT))
        moves = int(weather.storm_s / 2)
        for step in range(1, moves + 1):
            self.after(step * 2.0, self.move)
        # versions go on being heard when nobody moves any more
        for step in range(int(weather.calm_s)):
            self.after(moves * 2.0 + 1.0 + step, self.look)

    def _crash(self) -> None:
        victim, at_s = self._anybody(), self._moment_s()
        self.after(at_s, victim.stop)
        # every third stays away for good
        if self._random.random() < 0.67:
            self.after(at_s + self._random.choice((0.3, 3.0, 12.0)), victim.start)

    def _anybody(self) -> Node:
        return self.nodes[f"n{self._random.randrange(self.weather.nodes)}"]

    def _moment_s(self) -> float:
        return self._random.uniform(2.0, self.weather.storm_s)

    def roll_call(self) -> None:
        """All nodes publish once more, to all their subscribers."""
        for node in self.nodes.values():
            node.write("power/battery", "roll call")
            node.write("health/faults", "roll call", FrameKind.EVENT)
        self.run_for(20.0)

    # -- what must be true

    def wrong(self, *, events: bool) -> list[str]:
        """Everything that has not converged; `events`: every subscriber must have been told the newest."""
        found: list[str] = []
        for name, node in self.nodes.items():
            for other_name, other in self.nodes.items():
                if name == other_name or not self.radio.way(name, other_name):
                    continue
                if node.tree is not None and other.tree is not None:
                    found += self._wrong_pair(node, node.tree, other, other.tree, events)
        return found

    def _wrong_pair(
        self, node: Node, tree: SwarmTree, other: Node, theirs: SwarmTree, events: bool
    ) -> list[str]:
        replica = tree.replicas.get(other.name)
        patterns = tree.local_subscriptions.of(Address(other.name)).patterns
        if not (patterns or other.name in self.radio.near[node.name] or self.weather.whole_swarm):
            return []
        where = f"{node.name} of {other.name}"
        if replica is None or not replica.up:
            return [f"{where}: not known to be up"]
        if replica.digest != theirs.local.digest or replica.epoch != theirs.local.epoch:
            return [f"{where}: another structure"]
        found = []
        for path in sorted(_notified(theirs, theirs.local.digest, patterns)):
            value, mirror = other.values.get(path), node.mirrors.get((other.name, path))
            if value is not None and (events or value.kind == FrameKind.BOARD) and mirror != value:
                found.append(f"{where}: {path} is {mirror}, not {value}")
        wants = {resource.path for resource in replica.wants}
        offers = {offer.path for offer in theirs.subscribers.offers()} if wants else set()
        if not wants <= offers:
            found.append(f"{where}: wants {wants - offers} that are not offered")
        return found

    def events_wrong(self) -> list[str]:
        """Events of one start of their owner that came twice or in another order."""
        return [
            f"{node.name} of {owner}: {got}"
            for node in self.nodes.values()
            for (owner, _), got in node.events.items()
            if got != sorted(set(got))
        ]
