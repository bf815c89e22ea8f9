"""The own tree: template and applications, owners that go, answers in the fewest bytes."""

import logging

import pytest

from swarmd.tree.core.structure import structure
from swarmd.tree.core.structure.index import Index, leaf
from swarmd.tree.core.structure.local import LocalTree, OwnerTimeouts, merge
from swarmd.tree.core.structure.structure import StructureEncoding
from swarmware.model.resource import Kind, Resource
from swarmware.types.tree_exchange import StructureReply, StructureRequest

S = 1_000_000_000
POSE = Resource(
    path="nav/pose", type="Pose", rate_hz=20.0, log="10hz", owner="navigator", description="where"
)
BATTERY = Resource(path="power/battery", type="BatteryState", owner="hal")
EXTRA = Resource(path="plan/step", type="Text", owner="planner")


def tree() -> LocalTree:
    return LocalTree([POSE, BATTERY], 7, OwnerTimeouts(lost_ns=2 * S, expire_ns=10 * S))


def paths(one: LocalTree) -> dict[str, bool]:
    return {item.resource.path: item.lost for item in one.index}


def test_it_is_the_template_before_anything_runs() -> None:
    assert paths(tree()) == {"nav/pose": False, "power/battery": False}


def test_application_that_provides_what_was_planned_changes_nothing() -> None:
    one = tree()
    assert not one.set_live([Resource(path="nav/pose", type="Pose", rate_hz=20.0, owner="navigator")], 0)


def test_resource_outside_templates_expires_with_owner() -> None:
    one = tree()
    assert one.set_live([EXTRA], 0)
    assert one.deadline_ns() is None
    assert not one.set_live([], 5 * S)
    assert one.deadline_ns() == 7 * S
    assert not one.advance(7 * S - 1)
    assert one.advance(7 * S)
    assert paths(one)["plan/step"] is True
    assert one.deadline_ns() == 17 * S
    assert one.advance(17 * S)
    assert "plan/step" not in paths(one)
    assert one.deadline_ns() is None


def test_quick_restart_of_owner_is_not_seen_outside() -> None:
    one = tree()
    one.set_live([EXTRA], 0)
    digest = one.digest
    one.set_live([], 1 * S)
    one.set_live([EXTRA], 2 * S)
    assert one.deadline_ns() is None
    assert one.digest == digest


def test_returning_owner_finds_its_resource() -> None:
    one = tree()
    one.set_live([EXTRA], 0)
    digest = one.digest
    one.set_live([], 1 * S)
    one.advance(3 * S)
    assert one.digest != digest
    assert one.set_live([EXTRA], 4 * S)
    assert one.digest == digest


def test_templated_resource_is_planned_again_without_owner() -> None:
    one = tree()
    digest = one.digest
    one.set_live([Resource(path="power/battery", type="BatteryState", owner="driver2")], 0)
    assert one.digest != digest
    one.set_live([], 0)
    one.advance(2 * S)
    assert paths(one)["power/battery"] is True
    one.advance(12 * S)
    assert one.digest == digest


def test_the_application_knows_facts_the_template_decides_policy() -> None:
    live = Resource(path="nav/pose", type="Pose", rate_hz=5.0, owner="other", link="request", log="all")
    merged = merge(POSE, live)
    assert (merged.rate_hz, merged.owner) == (5.0, "other")
    assert (merged.link, merged.log, merged.description) == ("tick", "10hz", "where")


def test_contradiction_to_template_is_reported_and_overridden(
    caplog: pytest.LogCaptureFixture,
) -> None:
    live = Resource(path="nav/pose", kind=Kind.EVENT, type="Text", owner="other")
    with caplog.at_level(logging.WARNING):
        assert merge(POSE, live) is live
    assert "nav/pose: other provides it as event Text, the template defines board Pose" in caplog.text


def test_board_with_owners_inbox_stays_board() -> None:
    goal = Resource(path="nav/goal", type="Goal", access="rw")
    inbox = Resource(path="nav/goal", kind=Kind.COMMAND, type="Goal", owner="navigator")
    assert merge(goal, inbox).kind is Kind.BOARD
    one = LocalTree([], 7, OwnerTimeouts(lost_ns=0, expire_ns=0))
    one.set_live([goal, inbox], 0)
    two = LocalTree([], 7, OwnerTimeouts(lost_ns=0, expire_ns=0))
    two.set_live([inbox, goal], 0)
    assert one.digest == two.digest == leaf(goal).mark


def ask(one: LocalTree, held: int, *, full: bool = False) -> StructureReply:
    return one.answer(StructureRequest("gcs", 1, 2, held, full))


def test_present_structure_is_confirmed_in_few_bytes() -> None:
    one = tree()
    assert ask(one, one.digest).form is StructureEncoding.UNCHANGED


def test_holder_of_former_structure_gets_changes() -> None:
    one = tree()
    held = Index(one.index)
    one.set_live([EXTRA], 0)
    one.set_live([], 0)
    one.advance(2 * S)
    reply = ask(one, held.digest)
    assert reply.form is StructureEncoding.CHANGES
    structure.decode(reply.data).apply(held)
    assert held.digest == reply.digest == one.digest


def test_a_newcomer_gets_the_difference_to_the_template() -> None:
    one = tree()
    one.set_live([EXTRA, Resource(path="nav/pose", type="Pose", rate_hz=5.0, owner="navigator")], 0)
    reply = ask(one, 0)
    assert reply.form is StructureEncoding.TEMPLATE
    held = Index([leaf(POSE), leaf(BATTERY)])
    assert reply.base == held.digest
    structure.decode(reply.data).apply(held)
    assert held.digest == reply.digest
    assert ask(one, 12345).form is StructureEncoding.TEMPLATE, "of a structure that was never ours"


def test_who_does_not_know_the_template_gets_everything() -> None:
    one = tree()
    one.set_live([EXTRA], 0)
    reply = ask(one, 0, full=True)
    assert reply.form is StructureEncoding.FULL
    patch = structure.decode(reply.data)
    held = Index(patch.template)
    assert held.digest == reply.base
    patch.apply(held)
    assert held.digest == reply.digest


def test_the_version_follows_every_change() -> None:
    one = tree()
    version = one.version
    one.set_live([EXTRA], 0)
    assert one.version != version
