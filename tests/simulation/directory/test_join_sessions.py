"""What it costs in bytes that a node and 15 others accept each other and know each other's structures.

Brokers and trees as in the daemons, with keys, the shipped templates, and each byte as on the wire: questions
and answers about sessions, structures, and questions for them. What beacons also have at rest is not counted.
"""

from collections import Counter
from functools import partial
from pathlib import Path
from typing import Final

import pytest
from tests.simulation.directory.brokers import BrokerNode, SimulatedKeys, beacon_of, datagram, header_of
from tests.simulation.seeds import cases

from swarmd.broker.core.beacon.beacon import Beacon, Header
from swarmd.broker.core.beacon.parts import session_checks
from swarmd.broker.core.beacon.parts.structure_parts import StructurePart, question_bytes, structure_bytes
from swarmd.broker.core.boards.board_action import WriteStructure
from swarmd.broker.core.broker import Action
from swarmd.broker.core.reports.report import PublishTables
from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.tree.config import Config
from swarmd.tree.core.action import Action as TreeAction
from swarmd.tree.core.action import RequestStructure, RequestSubscription, SendNotify
from swarmd.tree.core.tree import Reachability, SwarmTree, reachable
from swarmware.model import template
from swarmware.model.resource import Resource
from swarmware.runtime.driver import CoreDriver
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.net import ConnectionStatus, TreePlan

OTHERS: Final = 15
NEW: Final = "uav16"
SETTLED_S: Final = 6.0
JOINED_S: Final = 3.0
FOLDER: Final = Path(__file__).parents[3] / "share" / "swarm" / "templates"
TEMPLATES: Final = {name: template.load(name, FOLDER).resources for name in ("gcs", "ugv", "multirotor")}
SESSION_BYTES: Final = 500
"""Limit of questions and answers; tree/test_join_bytes.py adds it to what trees take."""
JOIN_BYTES: Final = 1_000
"""Goal for all that a join adds to the beacons of 16 nodes, beside the structures themselves."""


class Member(BrokerNode):
    """A broker and the tree of its node."""

    def __init__(self, cell: "Cell", name: str, kind: str, *, tree_delay_s: float) -> None:
        """`tree_delay_s`: time after the start of the broker at which the tree is there."""
        super().__init__(cell, name, VirtualClock(cell), signing=SimulatedKeys(name))
        own = [resource for resource in TEMPLATES[kind] if resource.owner]
        extra = Resource(path=f"app/{name}", type="Text", owner="planner")
        self.tree = SwarmTree(
            name, TEMPLATES[kind], Config(), epoch=1000 + self.hw % 1000, templates=list(TEMPLATES.values())
        )
        self.requests = 0
        """What the tree wanted to send in frames."""
        self._reached: dict[str, Reachability] = {}
        self._tree_driver: CoreDriver[TreeAction] | None = None
        cell.after(tree_delay_s, partial(self._start_tree, cell, (*own, extra)))

    def _start_tree(self, cell: "Cell", running: tuple[Resource, ...]) -> None:
        self._tree_driver = cell.drive(self.tree, self._count_request, settled=self._take_plan)
        self._tree_driver.feed(self.tree.on_applications(running, (), cell.now_ns))
        self._reach()

    def _count_request(self, action: TreeAction) -> None:
        self.requests += isinstance(action, RequestStructure | RequestSubscription | SendNotify)

    def _take_plan(self) -> None:
        tree = self.tree
        if tree.plan_changed():
            needs = tuple(tree.replicas.needs())
            plan = TreePlan(tree.local.version, (), (), 0, tree.broadcast(), needs)
            self.driver.feed(self.core.on_plan(plan, self.clock.now_ns()))

    def _perform(self, action: Action) -> None:
        match action:
            case WriteStructure(structure):
                if self._tree_driver is not None:
                    self._tree_driver.feed(self.tree.on_broadcast(structure, self.clock.now_ns()))
            case PublishTables():
                self._reach()
            case _:
                super()._perform(action)

    def _reach(self) -> None:
        if self._tree_driver is None:
            return
        now_ns = self.clock.now_ns()
        neighbours = self.core.report.neighbours(lambda hw: ConnectionStatus.IDLE, now_ns)
        found = reachable(self.name, neighbours, None)
        before, self._reached = self._reached, found
        if found != before:
            self._tree_driver.feed(self.tree.on_multicast(frozenset(found), now_ns))
        for name, reach in found.items():
            if before.get(name) != reach:
                self._tree_driver.feed(self.tree.on_up(name, reach.version, reach.near, now_ns))


class Cell(VirtualSwarm[str]):
    """Nodes at rest that all receive each other, and what their beacons had of sessions and structures."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed, delay_s=(0.001, 0.02))
        self.counts: Counter[str] = Counter()
        self.members: dict[str, Member] = {}
        self.sent: list[bytes] = []

    def start(self, name: str, *, tree_delay_s: float = 0.0) -> Member:
        number = len(self.members)
        kind = "gcs" if number == 0 else "ugv" if number < 6 else "multirotor"
        member = self.members[name] = Member(self, name, kind, tree_delay_s=tree_delay_s)
        return member

    def multicast(self, sender: str, data: bytes) -> None:
        beacon = beacon_of(data)
        self.counts["checks"] += session_checks.body_bytes(len(beacon.checks))
        data_bytes = 0 if beacon.structure is None else len(beacon.structure.data)
        self.counts["structures"] += data_bytes
        self.counts["structure heads"] += structure_bytes(beacon.structure) - data_bytes
        self.counts["structure questions"] += question_bytes(len(beacon.structure_questions))
        self.sent.append(data)
        super().multicast(sender, data)

    def count(self, seconds: float) -> Counter[str]:
        """What was sent in this time."""
        self.counts = Counter()
        self.run_for(seconds)
        return self.counts

    def complete(self) -> bool:
        """Whether each tree has the structure that each other one has now."""
        members = self.members.values()
        return all(
            (replica := one.tree.replicas.get(two.name)) is not None
            and replica.digest == two.tree.local.digest
            for one in members
            for two in members
            if one is not two
        )


@pytest.mark.parametrize(
    ("seed", "tree_delay_s"),
    cases([(1, 0.0), (2, 0.7)], [(seed, delay_s) for seed in range(3, 11) for delay_s in (0.0, 0.7)]),
)
def test_joining_node_is_linked_to_fifteen_at_once(seed: int, tree_delay_s: float) -> None:
    cell = Cell(seed)
    for number in range(OTHERS):
        cell.start(f"uav{number + 1}")
    cell.run_for(SETTLED_S)
    assert cell.complete()
    before = cell.count(2.0)
    assert not before["checks"] + before["structures"] + before["structure questions"], "nodes at rest ask"
    node = cell.start(NEW, tree_delay_s=tree_delay_s)
    joining = cell.count(0.5)
    up = [state for state in node.link_states.values() if state is LinkState.UP]
    assert len(up) == OTHERS
    joining += cell.count(JOINED_S - 0.5)
    assert cell.complete()
    assert not sum(member.requests for member in cell.members.values()), "beacons bring everything"
    heads, questions = joining["structure heads"], joining["structure questions"]
    print(f"{joining['checks']} B of questions and answers, {heads} B of heads of structures,")
    print(f"{questions} B of questions for them, {joining['structures']} B")
    assert joining["checks"] <= SESSION_BYTES
    assert joining["structures"] <= 850, "each twice at most"
    assert joining["checks"] + heads + questions <= JOIN_BYTES


def test_false_beacon_changes_no_structure_of_neighbour() -> None:
    cell = Cell(seed=1)
    one, victim = cell.start("uav1"), cell.start("uav2")
    cell.run_for(4.0)
    assert cell.complete()
    taken = one.tree.replicas.get("uav2")
    assert taken is not None
    before = taken.digest
    last = next(data for data in reversed(cell.sent) if header_of(data).sender_hw == victim.hw)
    stamp_us = victim.clock.now_ns() // 1000 & 0xFFFF_FFFF
    for number, data in enumerate((b"", b"invented"), 1):
        header = Header(0, victim.hw, header_of(last).sequence + number, stamp_us, None)
        false = Beacon(structure=StructurePart(77, number, 0, data))
        one.receive("", datagram(victim.core.session, header, false))
    assert one.core.counters.refused.unsigned == 2
    assert taken.digest == before
