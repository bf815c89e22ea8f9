"""The manager: whose turn it is, what waits, what is suspended and how it goes on."""

from typing import Any

import pytest
from tests.unit.mission.nets import net
from tests.unit.mission.results import result
from tests.unit.mission.steps import A, B, Member1, S, words

from swarmd.mission.core.run import TRANSITIONS, PhaseEvent, ProgressStep, follow
from swarmd.mission.core.run_queue import QUEUE_LIMIT
from swarmware.errors import Conflict
from swarmware.types.control import ControlState, DriveMode
from swarmware.types.mission import MissionPhase, MissionState

GOTO = net(s="Start>g", g={"type": "Goto", "x": 1, "y": 1, "next": "e"}, e="End")
BOTH = (A, B)


def texts(actions: list[Any]) -> list[str]:
    """Steps of missions as a whole, with their mission."""
    return [
        f"{one.mission}: {one.event}" for one in actions if isinstance(one, ProgressStep) and not one.block
    ]


def test_second_mission_begins_after_the_first() -> None:
    m = Member1()
    m.order()
    assert m.order(name="two", epoch=8) == []
    assert m.queue() == {"hop": "running", "two": "waiting"}
    assert m.core.waits(8) == "after hop (7), priority 0"
    assert m.core.state().kept == (8,)
    steps = m.ended(1)
    assert steps == ["state:ending", "state:done", "state:ready", "state:running", "start a 2"]
    assert (m.core.epoch, m.core.state().kept, m.core.waits(8)) == (8, (), "")


def test_runs_wait_by_priority_then_number() -> None:
    m = Member1()
    m.order(priority=9)
    m.order(name="late", epoch=10)
    m.order(name="early", epoch=8)
    m.order(name="high", epoch=11, priority=5)
    assert list(m.queue()) == ["hop", "high", "early", "late"]
    assert [one.ordered_by for one in m.core.queue()] == ["anna@gcs"] * 4


def test_a_waiting_run_is_moved_and_cancelled() -> None:
    m = Member1()
    m.order(priority=9)
    m.order(name="two", epoch=8)
    m.order(name="three", epoch=9)
    m.core.on_priority(9, 5, S)
    assert list(m.queue()) == ["hop", "three", "two"]
    assert texts(m.core.on_cancel(9, "not needed", "", S)) == ["three: state:idle"]
    assert m.queue() == {"hop": "running", "two": "waiting"}
    assert m.core.on_cancel(99, "unknown run", "", S) == []


def test_an_impossible_order_says_why_at_once() -> None:
    m = Member1()
    m.order()
    m.values.battery = 0.1
    needs = net(s="Start>e", e="End").replace("{", '{"requires": ["battery > 20 %"], ', 1)
    with pytest.raises(Conflict, match="requirement 'battery > 20 %' is not met"):
        m.order(needs, epoch=8)
    m.core.on_control(ControlState(DriveMode.MANUAL, "anna@gcs"), S)
    with pytest.raises(Conflict, match="driven by hand by anna@gcs"):
        m.order(epoch=9)
    assert m.queue() == {"hop": "running"}


def test_the_queue_has_a_limit() -> None:
    m = Member1()
    m.order()
    for number in range(QUEUE_LIMIT):
        m.order(epoch=10 + number)
    with pytest.raises(Conflict, match="8 missions wait already"):
        m.order(epoch=99)


def test_a_requirement_is_checked_again_at_the_turn() -> None:
    m = Member1()
    m.order()
    needs = net(s="Start>e", e="End").replace("{", '{"requires": ["battery > 20 %"], ', 1)
    m.order(needs, name="needy", epoch=8)
    m.order(name="third", epoch=9)
    m.values.battery = 0.1
    steps = texts(m.core.on_ended(1, result("ok"), "", S))
    assert steps == [
        "hop: state:ending",
        "hop: state:done",
        "needy: state:idle",
        "third: state:ready",
        "third: state:running",
    ]


def test_a_higher_priority_suspends_the_running_mission() -> None:
    m = Member1()
    m.order(GOTO)
    assert m.order(name="rescue", epoch=8, priority=5) == ["state:suspending", "cancel 1", "preempts"]
    assert m.core.phase is MissionPhase.SUSPENDING
    assert m.ended(1, "cancelled") == ["state:suspended", "state:ready", "state:running", "start a 2"]
    assert m.queue() == {"rescue": "running", "hop": "suspended"}
    assert m.core.waits(7) == "rescue (8) of priority 5 comes first"
    assert m.ended(2) == ["state:ending", "state:done", "state:running", "start g 3"]
    assert m.ended(3) == ["state:ending", "state:done"]


def test_an_equal_priority_suspends_nothing() -> None:
    m = Member1()
    m.order(priority=5)
    assert m.order(epoch=8, priority=5) == []


def test_a_priority_given_later_suspends_as_well() -> None:
    m = Member1()
    m.order()
    m.order(name="two", epoch=8)
    assert words(m.core.on_priority(8, 1, S)) == ["priority", "state:suspending", "cancel 1", "preempts"]


def test_a_cancelled_rescue_lets_the_mission_go_on() -> None:
    m = Member1()
    m.order(GOTO)
    m.order(name="rescue", epoch=8, priority=5)
    m.core.on_cancel(8, "not needed", "", S)
    assert m.ended(1, "cancelled") == ["state:suspended", "state:running", "start g 2"]


def test_cancelling_a_suspended_mission_moves_no_vehicle() -> None:
    m = Member1()
    m.order(GOTO)
    m.order(name="rescue", epoch=8, priority=5)
    m.ended(1, "cancelled")
    assert texts(m.core.on_cancel(7, "enough", "", S)) == ["hop: state:ending", "hop: state:aborted"]
    assert m.queue() == {"rescue": "running"}


def test_a_landing_of_an_operator_ends_all_missions() -> None:
    m = Member1()
    m.order(GOTO)
    m.order(name="rescue", epoch=8, priority=5)
    m.ended(1, "cancelled")
    m.order(name="later", epoch=9)
    m.core.on_abort("operator", "land", S)
    assert m.ended(2, "cancelled") == ["state:recovering", "start land 3"]
    assert m.queue() == {"rescue": "recovering"}
    assert m.ended(3) == ["state:ending", "state:aborted"]
    assert m.core.state().kept == ()


def test_a_reaction_during_a_suspension_lands() -> None:
    m = Member1()
    m.order(GOTO)
    m.order(name="rescue", epoch=8, priority=5)
    assert words(m.core.on_reaction("battery critical", "land", S)) == [
        "state:idle",
        "state:ending",
    ]
    assert m.ended(1, "cancelled") == ["state:recovering", "start land 2"]


def test_a_failed_mission_lands_before_the_next() -> None:
    m = Member1()
    m.order()
    m.order(name="two", epoch=8)
    m.ended(1, "error:refused")
    assert m.core.waits(8) == "a is busy: land is recovering"
    assert m.ended(2) == ["state:ending", "state:failed", "state:ready", "state:running", "start a 3"]


def test_a_ready_run_makes_way_for_earlier_one() -> None:
    m = Member1()
    m.order(name="second", epoch=8, members=BOTH)
    assert m.order(name="first", epoch=7) == [
        "state:suspended",
        "preempts",
        "state:ready",
        "state:running",
        "start a 1",
    ]
    assert m.ended(1) == ["state:ending", "state:done", "state:ready"]
    assert m.core.state().arrivals[0].barrier == "@start"


def test_the_common_start_waits_for_busy_members() -> None:
    m = Member1()
    m.order(members=BOTH)
    busy = MissionState(3, "", MissionPhase.RUNNING, kept=(7,))
    for second in range(1, 30):
        m.core.on_states([("b", busy, ())], second * S)
        m.core.on_timer(second * S)
    assert m.phase == "ready"
    m.core.on_states([("b", MissionState(3, "", MissionPhase.DONE), ())], 30 * S)
    assert m.phase == "idle", "b keeps it no longer"


@pytest.mark.parametrize(
    ("block", "steps"),
    [
        ({"type": "Goto", "x": 1, "y": 1}, "start b 3"),
        ({"type": "Goto", "x": 1, "y": 1, "resume": "skip"}, "start next 3"),
        ({"type": "Goto", "x": 1, "y": 1, "resume": "abort", "nextError": "other"}, "start other 3"),
        ({"type": "Goto", "x": 1, "y": 1, "resume": "abort"}, "start land 3"),
        ({"type": "WaitForSensor"}, "start b 3"),
        ({"type": "Arm"}, "start b 3"),
    ],
)
def test_a_block_goes_on_by_type_or_key(block: dict[str, Any], steps: str) -> None:
    hold = {"type": "Hold", "next": "e"}
    m = Member1()
    m.order(net(s="Start>b", b={**block, "next": "next"}, next=hold, other=hold, e="End"))
    m.order(name="rescue", epoch=8, priority=5)
    m.ended(1, "cancelled")
    assert m.ended(2)[-1] == steps


@pytest.mark.parametrize(("resume", "rest_s"), [("continue", 3), ("restart", 4)])
def test_a_pause_continues_or_restarts(resume: str, rest_s: int) -> None:
    m = Member1()
    m.order(net(s="Start>w", w={"type": "Wait", "s": 4, "resume": resume, "next": "e"}, e="End"))
    m.order(name="rescue", epoch=8, priority=5, now=S)
    assert m.ended(2, now=20 * S)[-1] == "state:running"
    now = 20 * S
    while m.phase == "running":
        now = max(m.core.deadline_ns(), now)
        m.core.on_timer(now)
    assert now == (20 + rest_s) * S


def test_a_block_that_ends_meanwhile_keeps_its_result() -> None:
    m = Member1()
    m.order(net(s="Start>a", a={"type": "Arm", "next": "h"}, h={"type": "Hold", "next": "e"}, e="End"))
    m.order(name="rescue", epoch=8, priority=5)
    m.ended(1, "ok")
    assert m.ended(2)[-1] == "start h 3"


def test_branches_of_a_fork_are_all_kept() -> None:
    text = net(
        s="Start>f",
        f="Fork>g,w",
        g={"type": "Goto", "x": 1, "y": 1, "next": "j"},
        w="Wait>j",
        j="Join>e",
        e="End",
    )
    m = Member1()
    m.order(text)
    m.order(name="rescue", epoch=8, priority=5)
    m.ended(1, "cancelled")
    assert m.queue() == {"rescue": "running", "hop": "suspended"}
    assert m.ended(3)[-1] == "start g 5"
    assert set(m.core.state().active) == {"g", "w"}


def test_what_the_transitions_leave_out_is_refused() -> None:
    for phase in MissionPhase:
        for event in PhaseEvent:
            if (phase, event) not in TRANSITIONS:
                with pytest.raises(Conflict):
                    follow(phase, event)
