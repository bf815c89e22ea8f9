"""What it costs to join a swarm, to come back to it, and to be in it: bytes of frames with their headers.

The trees, templates and settings that are shipped; neighbours of one cell, in virtual time.
"""

from functools import partial
from pathlib import Path

import pytest

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
from swarmware.types.tree import TreeItem

S = 1_000_000_000
FOLDER = Path(__file__).parents[3] / "share" / "swarm" / "templates"
TEMPLATES = {name: template.load(name, FOLDER).resources for name in ("gcs", "ugv", "multirotor")}
EXTENSION_BYTES = len(with_lifetime(1.0))
ACK_BYTES = HEADER_BYTES + len(registry.encode(Ack(0, "uav10:tree#1", "", 10**15)))


class Cell(VirtualTime):
    """Trees that all hear each other; messages take 5 ms, versions are in every hello."""

    def __init__(self, patterns: dict[str, tuple[str, ...]], nodes: int = 16) -> None:
        super().__init__()
        self.bytes: dict[str, int] = {}
        self.structure_bytes: dict[str, int] = {}
        self.frames: dict[str, int] = {}
        self.trees: dict[str, SwarmTree] = {}
        self._drivers: dict[str, CoreDriver[Action]] = {}
        self.up: set[str] = set()
        for index in range(nodes):
            kind = "gcs" if index == 0 else "ugv" if index < 6 else "multirotor"
            name = "gcs" if index == 0 else f"ugv{index}" if index < 6 else f"uav{index}"
            self._start(name, TEMPLATES[kind], 1000 + index, patterns.get(name, ()))

    def _start(self, name: str, own: tuple[Resource, ...], epoch: int, patterns: tuple[str, ...]) -> None:
        tree = SwarmTree(name, own, Config(), epoch=epoch, templates=list(TEMPLATES.values()))
        self.trees[name] = tree
        self._drivers[name] = self.drive(
            tree, lambda action: self.after(0.005, partial(self._carry, name, action))
        )
        self.bytes[name] = self.structure_bytes[name] = self.frames[name] = 0
        running = [resource for resource in own if resource.owner]
        extra = Resource(path=f"app/{name}", type="Text", owner="planner")
        tree.on_applications([*running, extra], patterns, 0)

    def join(self, name: str) -> None:
        """It comes into the cell; all hear it, it hears all."""
        for other in sorted(self.up):
            for one, two in ((name, other), (other, name)):
                self._hear(one, two)
        self.up.add(name)

    def leave(self, name: str) -> None:
        self.up.discard(name)
        for other in sorted(self.up):
            self.feed(name, self.trees[name].on_gone(other, self.now_ns))
            self.feed(other, self.trees[other].on_gone(name, self.now_ns))

    def _hear(self, one: str, two: str) -> None:
        version = self.trees[two].local.version
        self.feed(one, self.trees[one].on_up(two, version, True, self.now_ns))

    def _perform(self, name: str, action: Action) -> None:
        self.after(0.005, partial(self._carry, name, action))

    def feed(self, name: str, actions: list[Action]) -> None:
        self._drivers[name].feed(actions)

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
                self._count(name, platform, HEADER_BYTES + EXTENSION_BYTES + len(registry.encode(request)))
                answer = registry.encode(Reply(True, registry.encode(reply)))
                self._count(name, platform, HEADER_BYTES + len(answer))
                self.structure_bytes[name] += len(reply.data)
                self.structure_bytes[platform] += len(reply.data)
                self.feed(name, tree.on_structure(platform, reply, self.now_ns))
                self.feed(platform, theirs)
            case RequestSubscription(platform, subscribe):
                granted, theirs = self.trees[platform].on_subscribe_asked(subscribe, None, self.now_ns)
                self._count(name, platform, HEADER_BYTES + EXTENSION_BYTES + len(registry.encode(subscribe)))
                answer = registry.encode(Reply(True, registry.encode(granted)))
                self._count(name, platform, HEADER_BYTES + len(answer))
                self.feed(name, tree.on_subscribed(platform, granted, subscribe.set_digest, self.now_ns))
                self.feed(platform, theirs)
            case SendNotify(platform, notify):
                self._count(name, platform, HEADER_BYTES + EXTENSION_BYTES + len(registry.encode(notify)))
                self._count(name, platform, ACK_BYTES)
                self.feed(platform, self.trees[platform].on_notify(notify, self.now_ns))
                self.feed(name, tree.on_notified(platform, notify, True, self.now_ns))

    def complete(self) -> bool:
        return all(
            (replica := self.trees[one].replicas.get(two)) is not None
            and replica.digest == self.trees[two].local.digest
            for one in self.up
            for two in self.up
            if one != two
        )


def cell(patterns: dict[str, tuple[str, ...]]) -> Cell:
    found = Cell(patterns)
    for name in found.trees:
        found.join(name)
        found.run_for(1.0)
    assert found.complete()
    return found


WANTS = {"uav9": ("/*/app/*", "/*/nav/pose"), "gcs": ("/*/app/*",)}


@pytest.mark.parametrize("patterns", [{}, WANTS])
def test_a_second_visit_to_sixteen_nodes_costs_at_most_a_hundred_bytes(
    patterns: dict[str, tuple[str, ...]],
) -> None:
    swarm = cell(patterns)
    swarm.leave("uav9")
    swarm.run_for(20)
    before = swarm.bytes["uav9"]
    swarm.join("uav9")
    swarm.run_for(5)
    assert swarm.complete()
    assert swarm.bytes["uav9"] - before <= 100
    swarm.feed("ugv1", swarm.trees["ugv1"].on_value(TreeItem("app/ugv1", 7, 1, 1, 1, b"x"), swarm.now_ns))
    swarm.run_for(1)
    assert (swarm.bytes["uav9"] - before > 100) is bool(patterns), "its subscription holds"


@pytest.mark.parametrize("patterns", [{}, WANTS])
def test_at_rest_nothing_is_sent_however_long(patterns: dict[str, tuple[str, ...]]) -> None:
    swarm = cell(patterns)
    before = dict(swarm.bytes)
    swarm.run_for(3600)
    assert swarm.bytes == before


def test_to_join_a_swarm_of_sixteen_costs_a_question_and_an_answer_with_each_and_the_structures() -> None:
    swarm = cell({})
    assert swarm.structure_bytes["uav15"] <= 850
    # thirty exchanges of some 150 bytes, of which the frames' headers are a hundred
    assert swarm.bytes["uav15"] - swarm.structure_bytes["uav15"] <= 4_700
