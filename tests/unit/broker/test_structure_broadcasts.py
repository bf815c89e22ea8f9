"""Structures in beacons: who asks, who answers, who is believed."""

import msgspec
import pytest

from swarmd.broker.core.beacon.beacon import Beacon
from swarmd.broker.core.beacon.structure_parts import StructurePart, signed_content
from swarmd.broker.core.structure_broadcasts import (
    QUESTIONS_MAX,
    REPEAT_NS,
    BeaconStructures,
    StructureBroadcasts,
)
from swarmware.model.names import hardware_id
from swarmware.transport.sodium import SigningKey
from swarmware.types.net import Refused, StructureBroadcast, TreePlan

ROOM = 600
SESSION = 5
NAMES = ("uav1", "uav2", "uav3")
UAV1, UAV2, UAV3 = (hardware_id(name) for name in NAMES)
MEMBERS = {name: SigningKey(name.encode().ljust(32, b"x")) for name in NAMES}


class Keys:
    """Of one member."""

    def __init__(self, name: str, *, is_open: bool = False) -> None:
        self.is_open = is_open
        self._key = MEMBERS[name]

    def sign(self, data: bytes) -> bytes:
        return self._key.sign(data)

    def sign_public_of(self, platform: str) -> bytes | None:
        return MEMBERS[platform].public if platform in MEMBERS else None


class Node:
    """The structures of one node, and what it was sent."""

    def __init__(self, name: str, *, signs: bool = True) -> None:
        self.name = name
        self.hw = hardware_id(name)
        self.refused = Refused()
        keys = Keys(name, is_open=not signs)
        self.core = StructureBroadcasts(self.hw, SESSION, keys, self.refused)

    def plan(self, *needs: str, digest: int = 11) -> list[StructureBroadcast]:
        own = StructureBroadcast(self.name, 1, digest, 3, b"changes")
        return self.core.set_plan(TreePlan(1, (), (), 0, own, needs))

    def beacon(
        self, now_ns: int = 0, *, room: int = ROOM, has_neighbours: bool = True, is_signed: bool = False
    ) -> Beacon:
        found = self.core.compose(now_ns, room, has_neighbours=has_neighbours, is_signed=is_signed)
        assert found.bytes <= max(room, 0)
        return Beacon(structure=found.structure, structure_questions=found.questions)

    def hear(
        self, other: "Node", beacon: Beacon, now_ns: int = 0, *, is_signed: bool = False
    ) -> StructureBroadcast | None:
        return self.core.on_beacon(other.hw, other.name, SESSION, beacon, now_ns, is_signed=is_signed)


@pytest.mark.parametrize("signs", [True, False])
def test_a_node_that_is_asked_sends_its_structure_once_and_every_neighbour_takes_it(signs: bool) -> None:
    asks, owner, third = (Node(name, signs=signs) for name in NAMES)
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


def test_a_changed_structure_is_sent_without_a_question_unless_nobody_hears_it() -> None:
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


def test_a_node_that_meets_others_offers_its_structure_in_the_beacon_that_is_signed_for_that() -> None:
    newcomer, owner, third = (Node(name) for name in NAMES)
    owner.plan()
    owner.core.offer()
    offered = owner.beacon(has_neighbours=False, is_signed=True)
    assert offered.structure == StructurePart(1, 11, 3, b"changes"), "the beacon has a signature already"
    assert owner.beacon() == Beacon()
    expected = StructureBroadcast("uav2", 1, 11, 3, b"changes")
    assert newcomer.hear(owner, offered, is_signed=True) == expected
    assert third.hear(owner, offered) is None, "in an unsigned beacon anybody can have written it"
    assert (newcomer.refused.spoofed, third.refused.spoofed) == (0, 1)


def test_an_offer_without_room_follows_with_a_signature_of_its_own_and_one_without_a_structure_lapses() -> (
    None
):
    owner, asks = Node("uav2"), Node("uav1")
    owner.core.offer()
    assert owner.beacon(is_signed=True) == Beacon()
    owner.plan()
    assert owner.beacon() == Beacon(), "whoever needs it asks"
    owner.core.offer()
    assert owner.beacon(room=20, is_signed=True) == Beacon()
    later = owner.beacon()
    assert later.structure is not None
    assert len(later.structure.signature) == 64
    assert asks.hear(owner, later) is not None
    assert asks.hear(owner, Beacon(structure=StructurePart(1, 11, 3, b"changes"))) is None
    assert not asks.refused.spoofed, "it has this one"


def test_a_structure_that_came_before_the_tree_needed_it_is_given_to_it_once_without_a_question() -> None:
    owner, asks = Node("uav2"), Node("uav1")
    owner.plan()
    owner.core.offer()
    asks.hear(owner, owner.beacon(is_signed=True), is_signed=True)
    assert asks.plan("uav2", "uav3") == [StructureBroadcast("uav2", 1, 11, 3, b"changes")]
    assert asks.plan("uav2", "uav3") == []
    assert asks.beacon().structure_questions == (UAV2, UAV3), "it may be an older one"


def test_a_question_is_repeated_until_the_structure_is_not_needed_any_more() -> None:
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


def test_who_hears_the_question_of_another_node_or_the_answer_does_not_ask() -> None:
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


def test_a_structure_waits_for_a_beacon_with_room_and_questions_are_spread_over_beacons() -> None:
    owner = Node("uav2")
    owner.plan(*(f"uav{number}" for number in range(10, 10 + QUESTIONS_MAX + 20)))
    owner.plan(*(f"uav{number}" for number in range(10, 10 + QUESTIONS_MAX + 20)), digest=12)
    assert owner.beacon(room=0) == Beacon()
    small = owner.beacon(room=50)
    assert small.structure is None
    assert len(small.structure_questions) == 11
    large = owner.beacon(room=1200)
    assert large.structure is not None
    assert len(large.structure_questions) == QUESTIONS_MAX
    assert len(owner.beacon(room=1200).structure_questions) == 9


def test_a_node_without_a_structure_for_beacons_does_not_answer() -> None:
    owner = Node("uav2")
    owner.hear(Node("uav1"), Beacon(structure_questions=(UAV2,)))
    assert not owner.core.is_due(0)
    assert owner.beacon() == Beacon()


def answer() -> tuple[Node, StructurePart]:
    owner = Node("uav2")
    owner.plan()
    owner.plan(digest=12)
    part = owner.beacon().structure
    assert part is not None
    return owner, part


@pytest.mark.parametrize(
    "changes",
    [
        {"data": b"others!"},
        {"digest": 9},
        {"base": 9},
        {"epoch": 9},
        {"signature": b""},
        {"signature": bytes(64)},
    ],
)
def test_a_structure_that_its_node_did_not_sign_is_refused_and_counted(changes: dict[str, object]) -> None:
    owner, part = answer()
    asks = Node("uav1")
    asks.plan("uav2")
    assert asks.hear(owner, Beacon(structure=msgspec.structs.replace(part, **changes))) is None
    assert asks.refused.spoofed == 1
    assert asks.hear(owner, Beacon(structure=part)) is not None


def test_a_member_cannot_send_the_structure_of_another_one_nor_one_of_a_former_session() -> None:
    owner, part = answer()
    asks, other = Node("uav1"), Node("uav3")
    assert asks.hear(other, Beacon(structure=part)) is None, "signed for another sender"
    assert asks.core.on_beacon(owner.hw, "uav2", SESSION + 1, Beacon(structure=part), 0) is None
    forged = msgspec.structs.replace(part, signature=Keys("uav3").sign(signed_content(UAV2, SESSION, part)))
    assert asks.hear(owner, Beacon(structure=forged)) is None
    assert asks.core.on_beacon(7, "usv9", SESSION, Beacon(structure=part), 0) is None, "not a member"
    assert asks.refused.spoofed == 4


def test_a_structure_is_given_to_the_tree_once_unless_it_needs_it_again() -> None:
    owner, part = answer()
    asks = Node("uav1")
    beacon = Beacon(structure=part)
    assert asks.hear(owner, beacon) is not None
    assert asks.hear(owner, beacon) is None
    asks.plan("uav2")
    assert asks.hear(owner, beacon) is not None


def test_units_of_a_platform_are_asked_and_believed_one_by_one() -> None:
    asks = Node("uav1")
    asks.plan("uav2.fc", "uav2")
    assert asks.beacon().structure_questions == (hardware_id("uav2", "fc"), UAV2)
    hw = hardware_id("uav2", "fc")
    part = StructurePart(1, 2, 0, b"x")
    part = msgspec.structs.replace(part, signature=MEMBERS["uav2"].sign(signed_content(hw, SESSION, part)))
    found = asks.core.on_beacon(hw, "uav2.fc", SESSION, Beacon(structure=part), 0)
    assert found is not None
    assert found.node == "uav2.fc"


def test_the_size_of_what_a_beacon_has_is_that_of_its_bytes() -> None:
    assert BeaconStructures().bytes == 0
    assert (
        BeaconStructures(StructurePart(1, 2, 3, b"12345", bytes(64)), (1, 2)).bytes == 3 + 21 + 64 + 5 + 3 + 8
    )
