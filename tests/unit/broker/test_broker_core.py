"""The broker's core under its driver: when beacons leave, what waits for the inputs, what is reported."""

from typing import Final

import pytest
from tests.simulation.directory.brokers import BrokerNode

from swarmd.broker.core.beacon.beacon_rate import ReportSlowdown
from swarmd.broker.core.boards.board_action import KeepMirrors, LimitEnded, WriteMirrors
from swarmd.broker.core.broker import DUPLICATE_NS, PUBLISH_NS
from swarmd.broker.core.membership.sessions import ReportDuplicate, ReportDuplicateGone
from swarmd.broker.core.reports.report import PublishTables
from swarmd.broker.core.swarm.clock_batches import WriteClockSamples
from swarmd.broker.core.swarm.links.link import LinkState
from swarmware.model.names import data_id
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.channel import ChannelSettings, SetChannel
from swarmware.types.net import BoardPublication, BoardSubscription, ConnectionStatus, TreePlan

SECOND: Final = 1_000_000_000
POSE: Final = data_id("nav/pose", "Pose")
OFFER: Final = BoardPublication("nav/pose", POSE, "Pose")


def pair(seed: int = 0) -> tuple[VirtualSwarm[str], BrokerNode, BrokerNode]:
    air: VirtualSwarm[str] = VirtualSwarm(seed)
    air.now_ns = SECOND
    return air, BrokerNode(air, "uav1", VirtualClock(air)), BrokerNode(air, "uav2", VirtualClock(air))


def up(node: BrokerNode) -> list[str]:
    return [
        neighbour.platform
        for neighbour in node.core.report.neighbours(
            lambda hw: ConnectionStatus.IDLE, node.clock.now_ns()
        ).neighbours
        if neighbour.state == "up"
    ]


def test_two_nodes_are_up_after_session_exchange() -> None:
    air, one, other = pair()
    air.run_for(1.0)
    assert up(one) == ["uav2"]
    assert up(other) == ["uav1"]
    assert one.core.counters.refused.unproven > 0, "a session counts after it has answered"
    assert [route.platform for route in one.core.report.routes().routes] == ["uav2"]


@pytest.mark.parametrize("hundredths", range(0, 60, 7))
def test_resting_node_that_ended_is_missed_soon(hundredths: int) -> None:
    air, one, other = pair(hundredths)
    air.run_for(20.0 + hundredths / 100)
    other.stop()
    air.run_for(0.45)
    assert up(one) == ["uav2"], "one lost beacon is no lost node"
    air.run_for(0.6)
    assert up(one) == []


def test_deadlines_are_judged_after_reading_inputs() -> None:
    air, one, other = pair()
    air.run_for(2.0)
    other.stop()
    silent_ns = air.now_ns + 20 * SECOND
    assert one.core.begin_turn(silent_ns), "a beacon is due, and needs the boards"
    assert up(one) == ["uav2"], "its datagrams may wait in the socket"
    actions = one.core.on_timer(silent_ns)
    assert up(one) == []
    assert [change.after for change in actions if hasattr(change, "after")] == [LinkState.DOWN]


@pytest.mark.parametrize(("late_s", "period_ms"), [(0.05, 500), (2.0, 800)])
def test_late_node_declares_lateness_of_next_beacons(late_s: float, period_ms: int) -> None:
    air, one, _ = pair()
    air.run_for(30.0)
    due_ns = one.core.deadline_ns()
    assert due_ns is not None
    late_ns = due_ns + round(late_s * SECOND)
    one.core.begin_turn(late_ns)
    one.core.on_timer(late_ns)
    declared = [one.core.compose(late_ns + second * SECOND).beacon.hello for second in range(3)]
    assert {hello.period_ms for hello in declared if hello is not None} == {period_ms}


def test_beacon_leaves_only_with_boards_read_for_it() -> None:
    air, one, _ = pair()
    air.run_for(2.0)
    due_ns = one.core.deadline_ns()
    assert due_ns is not None
    assert not one.core.begin_turn(due_ns - 1)
    late_ns = due_ns + 10 * SECOND
    one.core.on_timer(late_ns)
    due = [one.core.beacon_due]  # it became due while the inputs were read
    assert one.core.begin_turn(late_ns)
    one.core.on_timer(late_ns)
    due.append(one.core.beacon_due)
    one.core.compose(late_ns)
    assert [*due, one.core.beacon_due] == [False, True, False]


def test_tables_are_published_each_second_and_after_change() -> None:
    air, one, other = pair()
    air.run_for(10.0)
    one.actions.clear()
    air.run_for(5.0)
    assert one.of(PublishTables) == [PublishTables(traffic=True)] * 5
    one.actions.clear()
    other.stop()
    air.run_until((air.now_ns // PUBLISH_NS + 4) * PUBLISH_NS - 1)
    assert up(one) == []
    assert PublishTables(traffic=False) in one.actions


def test_clock_samples_are_handed_on_with_own_beacon() -> None:
    air, one, _ = pair()
    air.run_for(3.0)
    found = one.of(WriteClockSamples)
    assert found
    assert {sample.platform for action in found for sample in action.batch.samples} == {"uav2"}  # type: ignore[union-attr]
    assert len(found) <= one.sent


def test_clock_samples_are_batched_and_complete() -> None:
    air, one, other = pair()
    air.run_for(20.0)
    one.actions.clear()
    sent = other.sent
    air.run_for(10.0)
    batches = one.of(WriteClockSamples)
    assert 10 <= len(batches) <= 21
    samples = sum(len(action.batch.samples) for action in batches if isinstance(action, WriteClockSamples))
    assert samples == pytest.approx(other.sent - sent, abs=3)


def test_new_plan_keeps_mirrors_and_known_values() -> None:
    air, one, other = pair()
    other.core.on_plan(TreePlan(1, (OFFER,)), air.now_ns)
    other.core.published.boards[POSE].put(b"x" * 25, True, air.now_ns)
    air.run_for(2.0)
    want = BoardSubscription("uav2", "nav/pose", "Pose", POSE)
    kept, written = one.core.on_plan(TreePlan(1, (), (want,)), air.now_ns)
    assert kept == KeepMirrors((want,))
    assert isinstance(written, WriteMirrors)
    assert [(which, value.payload) for which, value in written.values] == [(want, b"x" * 25)]


def test_duplicate_name_is_reported_until_one_is_silent() -> None:
    air, one, other = pair()
    air.run_for(2.0)
    copy = BrokerNode(air, "copy", VirtualClock(air), session=2)
    copy.core.identity = other.core.identity
    copy.hw = other.hw
    air.run_for(4.0)
    assert ReportDuplicate("uav2", own=False, first=True) in one.actions
    assert one.actions.count(ReportDuplicate("uav2", own=False, first=True)) == 1
    copy.stop()
    one.actions.clear()
    air.run_for(DUPLICATE_NS / 1e9 + 2.0)
    assert one.of(ReportDuplicateGone) == [ReportDuplicateGone()]


def test_late_beacons_are_reported_as_a_slowdown() -> None:
    air, one, _ = pair()
    air.run_for(2.0)
    found = []
    for _ in range(12):
        due_ns = one.core._schedule.due_ns + 2 * SECOND
        one.core.begin_turn(due_ns)
        found += one.core.on_timer(due_ns)
        one.core.compose(due_ns)
    slowed = [action for action in found if isinstance(action, ReportSlowdown)]
    assert slowed[0].factor > 1
    assert slowed[0].late_ns >= SECOND


def test_limits_are_written_when_they_end() -> None:
    air, one, _ = pair()
    one.core.channels.set(SetChannel("nav/*", ChannelSettings(2.0), for_s=3.0), air.now_ns)
    assert [limit.pattern for limit in one.core.channels.limits(air.now_ns).limits] == ["nav/*"]
    air.run_for(4.0)
    assert len(one.of(LimitEnded)) == 1
    assert one.core.channels.limits(air.now_ns).limits == ()
