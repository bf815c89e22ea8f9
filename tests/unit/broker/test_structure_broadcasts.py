"""Structures in beacons: who asks, who answers."""

from swarmd.broker.core.beacon.beacon import Beacon
from swarmd.broker.core.beacon.parts.structure_parts import StructurePart
from swarmd.broker.core.boards.structure_broadcasts import (
    QUESTIONS_MAX,
    REPEAT_NS,
    BeaconStructures,
    StructureBroadcasts,
)
from swarmware.model.names import hardware_id
from swarmware.types.net import StructureBroadcast, TreePlan

ROOM = 600
NAMES = ("uav1", "uav2", "uav3")
UAV1, UAV2, UAV3 = (hardware_id(name) for name in NAMES)


class Node:
    """The structures of one node, and what it was sent."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.hw = hardware_id(name)
        self.core = StructureBroadcasts(self.hw)

    def plan(self, *needs: str, digest: int = 11) -> list[StructureBroadcast]:
        own = StructureBroadcast(self.name, 1, digest, 3, b"changes")
        return self.core.set_plan(TreePlan(1, (), (), 0, own, needs))

    def beacon(self, now_ns: int = 0, *, room: int = ROOM, has_neighbours: bool = True) -> Beacon:
        found = self.core.compose(now_ns, room, has_neighbours=has_neighbours)
        assert found.bytes <= max(room, 0)
        return Beacon(structure=found.structure, structure_questions=found.questions)

    def hear(self, other: "Node", beacon: Beacon, now_ns: int = 0) -> StructureBroadcast | None:
        return self.core.on_beacon(other.hw, other.name, beacon, now_ns)


def test_asked_node_sends_structure_once_to_all_neighbours() -> None:
    asks, owner, third = (Node(name) for name in NAMES)
    owner.plan()
    assert owner.beacon() == Beacon(), "nobody has asked"
    asks.plan("uav2")
    question = asks.beacon()
    assert question.structure_questions == (owner.hw,)
    assert owner.hear(asks, question) is None
    answer = owner.beacon()
    expected = StructureBroadcast("uav2", 1, 11, 3, b"changes")
    assert asks.hear(owner, answer) == expected
    assert third.hear(owner, answer) == expected
    assert owner.beacon() == Beacon()


def test_changed_structure_is_sent_without_question() -> None:
    owner = Node("uav2")
    owner.plan()
    owner.plan(digest=12)
    assert owner.core.is_due(0)
    assert owner.beacon(has_neighbours=False) == Beacon()
    assert owner.beacon() == Beacon(), "whoever comes later asks"
    owner.plan(digest=13)
    part = owner.beacon().structure
    assert part is not None
    assert part.digest == 13


def test_node_meeting_others_offers_structure_in_next_beacon() -> None:
    newcomer, owner = Node("uav1"), Node("uav2")
    owner.plan()
    owner.core.offer()
    offered = owner.beacon(has_neighbours=False)
    assert owner.beacon() == Beacon()
    assert newcomer.hear(owner, offered) == StructureBroadcast("uav2", 1, 11, 3, b"changes")
    assert newcomer.hear(owner, offered) is None, "it has this one"


def test_offer_without_room_follows_without_structure_lapses() -> None:
    owner, asks = Node("uav2"), Node("uav1")
    owner.core.offer()
    assert owner.beacon() == Beacon()
    owner.plan()
    assert owner.beacon() == Beacon(), "whoever needs it asks"
    owner.core.offer()
    assert owner.beacon(room=20) == Beacon()
    assert asks.hear(owner, owner.beacon()) is not None


def test_early_structure_is_given_to_tree_once() -> None:
    owner, asks = Node("uav2"), Node("uav1")
    owner.plan()
    owner.core.offer()
    asks.hear(owner, owner.beacon())
    assert asks.plan("uav2", "uav3") == [StructureBroadcast("uav2", 1, 11, 3, b"changes")]
    assert asks.plan("uav2", "uav3") == []
    assert asks.beacon().structure_questions == (UAV2, UAV3), "it may be an older one"


def test_question_is_repeated_until_structure_is_unneeded() -> None:
    asks = Node("uav1")
    asks.plan("uav2", "uav3")
    assert asks.beacon(0).structure_questions == (UAV2, UAV3)
    assert not asks.core.is_due(REPEAT_NS - 1)
    assert asks.beacon(REPEAT_NS - 1) == Beacon()
    asks.plan("uav3")
    assert asks.core.is_due(REPEAT_NS)
    assert asks.beacon(REPEAT_NS).structure_questions == (UAV3,)
    asks.plan()
    assert asks.beacon(9 * REPEAT_NS) == Beacon()


def test_node_receiving_question_or_answer_does_not_ask() -> None:
    first, second, owner = (Node(name) for name in ("uav1", "uav3", "uav2"))
    for node in (first, second):
        node.plan("uav2")
    owner.plan()
    second.hear(first, first.beacon(100), 100)
    assert second.beacon(200) == Beacon()
    assert second.beacon(100 + REPEAT_NS).structure_questions == (UAV2,)
    late = Node("uav1")
    late.plan("uav2")
    owner.hear(second, Beacon(structure_questions=(UAV2,)))
    assert late.hear(owner, owner.beacon(), 300) is not None
    assert late.beacon(400) == Beacon(), "its tree takes it in a moment"


def test_structure_waits_for_room_and_questions_are_spread() -> None:
    owner = Node("uav2")
    owner.plan(*(f"uav{number}" for number in range(10, 10 + QUESTIONS_MAX + 20)))
    owner.plan(*(f"uav{number}" for number in range(10, 10 + QUESTIONS_MAX + 20)), digest=12)
    assert owner.beacon(room=0) == Beacon()
    small = owner.beacon(room=29)
    assert small.structure is None
    assert len(small.structure_questions) == 6
    large = owner.beacon(room=1200)
    assert large.structure is not None
    assert len(large.structure_questions) == QUESTIONS_MAX
    assert len(owner.beacon(room=1200).structure_questions) == 14


def test_node_without_structure_for_beacons_does_not_answer() -> None:
    owner = Node("uav2")
    owner.hear(Node("uav1"), Beacon(structure_questions=(UAV2,)))
    assert not owner.core.is_due(0)
    assert owner.beacon() == Beacon()


def test_structure_reaches_tree_once_unless_needed_again() -> None:
    owner, asks = Node("uav2"), Node("uav1")
    beacon = Beacon(structure=StructurePart(1, 12, 3, b"changes"))
    assert asks.hear(owner, beacon) is not None
    assert asks.hear(owner, beacon) is None
    asks.plan("uav2")
    assert asks.hear(owner, beacon) is not None


def test_units_of_platform_are_asked_one_by_one() -> None:
    asks = Node("uav1")
    asks.plan("uav2.fc", "uav2")
    assert asks.beacon().structure_questions == (hardware_id("uav2", "fc"), UAV2)
    hw = hardware_id("uav2", "fc")
    found = asks.core.on_beacon(hw, "uav2.fc", Beacon(structure=StructurePart(1, 2, 0, b"x")), 0)
    assert found is not None
    assert found.node == "uav2.fc"


def test_size_of_section_equals_its_bytes() -> None:
    assert BeaconStructures().bytes == 0
    assert BeaconStructures(StructurePart(1, 2, 3, b"12345"), (1, 2)).bytes == 3 + 20 + 5 + 3 + 8
