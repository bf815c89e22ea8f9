"""A radio cell whose nodes join, with each byte counted."""

import random
from collections.abc import Collection
from functools import partial
from pathlib import Path

import msgspec
from tests.simulation.tree.beacons import BeaconAir

from swarmd.tree.config import Config
from swarmd.tree.core.action import Action, RequestStructure, RequestSubscription, SendNotify
from swarmd.tree.core.tree import SwarmTree
from swarmware.model import template
from swarmware.model.frame import HEADER_BYTES
from swarmware.model.resource import Resource
from swarmware.runtime.driver import CoreDriver
from swarmware.testing.virtual import VirtualTime
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.types import registry
from swarmware.types.rpc import Ack, Reply

FOLDER = Path(__file__).parents[3] / "share" / "swarm" / "templates"


TEMPLATES = {name: template.load(name, FOLDER).resources for name in ("gcs", "ugv", "multirotor")}


EXTENSION_BYTES = len(with_lifetime(1.0))


LINKS_S = 0.5
"""Time in which the links of a node come up, while the beacons of both ends answer each other."""


ACK_BYTES = HEADER_BYTES + len(registry.encode(Ack(0, "uav10:tree#1", "", 10**15)))


class Cell(VirtualTime):
    """Trees that all hear each other; messages take 5 ms, versions are in every hello.

    A frame that is lost is sent again until it is answered, as the delivery of messages does it.
    """

    def __init__(
        self,
        patterns: dict[str, tuple[str, ...]],
        nodes: int = 16,
        *,
        seed: int = 1,
        loss: float = 0.0,
        former: Collection[str] = (),
    ) -> None:
        """`loss`: share of frames and beacons; `former`: nodes of a version without structures in beacons."""
        super().__init__()
        self.loss = loss
        self.former = frozenset(former)
        self._chance = random.Random(seed)
        self.air = BeaconAir(self, self._chance, self._near, self.feed, loss=loss, count=self._count_beacon)
        self.bytes: dict[str, int] = {}
        self.structure_bytes: dict[str, int] = {}
        self.frames: dict[str, int] = {}
        self.beacon_bytes: dict[str, int] = {}
        """Bytes of structures and questions in beacons, sent and received."""
        self.trees: dict[str, SwarmTree] = {}
        self._drivers: dict[str, CoreDriver[Action]] = {}
        self.up: set[str] = set()
        self._met: set[frozenset[str]] = set()
        """Pairs that have accepted the sessions of each other."""
        kinds = ["gcs" if index == 0 else "ugv" if index < 6 else "multirotor" for index in range(nodes)]
        short = {"gcs": "", "ugv": "ugv", "multirotor": "uav"}
        names = [f"{short[kind]}{index}" if index else kind for index, kind in enumerate(kinds)]
        self._names = frozenset(names)
        for index, (name, kind) in enumerate(zip(names, kinds, strict=True)):
            self._start(name, TEMPLATES[kind], 1000 + index, patterns.get(name, ()))

    def _start(self, name: str, own: tuple[Resource, ...], epoch: int, patterns: tuple[str, ...]) -> None:
        config = Config()
        if name in self.former:
            config = msgspec.structs.replace(config, broadcast_s=0.0)
        tree = SwarmTree(name, own, config, epoch=epoch, templates=list(TEMPLATES.values()))
        self.trees[name] = tree
        if name in self._drivers:
            self._drivers[name].stop()
        self._drivers[name] = self.drive(
            tree, partial(self._perform, name), settled=partial(self.air.on_settled, name)
        )
        if name not in self.bytes:
            self.bytes[name] = self.structure_bytes[name] = self.frames[name] = self.beacon_bytes[name] = 0
        running = [resource for resource in own if resource.owner]
        extra = Resource(path=f"app/{name}", type="Text", owner="planner")
        tree.on_applications([*running, extra], patterns, self.now_ns)
        tree.on_multicast(self._names, self.now_ns)
        if name not in self.former:
            self.air.join(tree)

    def restart(self, name: str, kind: str, epoch: int) -> None:
        """The tree service of a node starts again: it knows nothing, and has another epoch."""
        self._start(name, TEMPLATES[kind], epoch, ())
        self.join(name)

    def join(self, name: str) -> None:
        """The node enters the cell; it and all others receive each other as soon as their link is up."""
        for other in sorted(self.up - {name}):
            if (pair := frozenset((name, other))) not in self._met:
                self._met.add(pair)
                self.air.meet(name, other)
            for one, two in ((name, other), (other, name)):
                self.after(self._chance.uniform(0, LINKS_S), partial(self._hear, one, two))
        self.up.add(name)

    def leave(self, name: str) -> None:
        self.up.discard(name)
        for other in sorted(self.up):
            self.feed(name, self.trees[name].on_gone(other, self.now_ns))
            self.feed(other, self.trees[other].on_gone(name, self.now_ns))

    def _hear(self, one: str, two: str) -> None:
        if not {one, two} <= self.up:
            return
        version = self.trees[two].local.version
        self.feed(one, self.trees[one].on_up(two, version, True, self.now_ns))

    def _near(self, name: str) -> list[str]:
        return sorted(self.up - {name} if name in self.up else ())

    def _perform(self, name: str, action: Action) -> None:
        self.after(0.005, partial(self._carry, name, action))

    def feed(self, name: str, actions: list[Action]) -> None:
        self._drivers[name].feed(actions)

    def _count_beacon(self, sender: str, receivers: list[str], size: int, structure: int) -> None:
        for name in (sender, *receivers):
            self.bytes[name] += size
            self.beacon_bytes[name] += size
            self.structure_bytes[name] += structure

    def _exchange(self, one: str, two: str, request: int, answer: int) -> None:
        """Request and answer with their repetitions; a request that is repeated has its answer repeated."""
        while True:
            self._count(one, two, request)
            if self._chance.random() < self.loss:
                continue
            self._count(one, two, answer)
            if self._chance.random() >= self.loss:
                return

    def _count(self, one: str, two: str, size: int) -> None:
        self.bytes[one] += size
        self.bytes[two] += size
        self.frames[one] += 1
        self.frames[two] += 1

    def _carry(self, name: str, action: Action) -> None:
        tree = self.trees[name]
        match action:
            case RequestStructure(platform, request):
                reply, theirs = self.trees[platform].on_structure_asked(request, self.now_ns)
                answer = registry.encode(Reply(True, registry.encode(reply)))
                self._request(name, platform, request, answer)
                self.structure_bytes[name] += len(reply.data)
                self.structure_bytes[platform] += len(reply.data)
                self.feed(name, tree.on_structure(platform, reply, self.now_ns))
                self.feed(platform, theirs)
            case RequestSubscription(platform, subscribe):
                granted, theirs = self.trees[platform].on_subscribe_asked(subscribe, None, self.now_ns)
                answer = registry.encode(Reply(True, registry.encode(granted)))
                self._request(name, platform, subscribe, answer)
                self.feed(name, tree.on_subscribed(platform, granted, subscribe.set_digest, self.now_ns))
                self.feed(platform, theirs)
            case SendNotify(platform, notify):
                size = HEADER_BYTES + EXTENSION_BYTES + len(registry.encode(notify))
                self._exchange(name, platform, size, ACK_BYTES)
                self.feed(platform, self.trees[platform].on_notify(notify, self.now_ns))
                self.feed(name, tree.on_notified(platform, notify, True, self.now_ns))

    def _request(self, one: str, two: str, request: msgspec.Struct, answer: bytes) -> None:
        size = HEADER_BYTES + EXTENSION_BYTES + len(registry.encode(request))
        self._exchange(one, two, size, HEADER_BYTES + len(answer))

    def complete(self) -> bool:
        return all(
            (replica := self.trees[one].replicas.get(two)) is not None
            and replica.digest == self.trees[two].local.digest
            for one in self.up
            for two in self.up
            if one != two
        )
