"""One member: order, common start, failure, built-in missions, abort, requirements."""

from typing import Any

import pytest
from tests.unit.mission.nets import net
from tests.unit.mission.results import result
from tests.unit.mission.steps import ARM, A, B, Member1, S, words

from swarmd.mission.core.announcement import Announcer
from swarmd.mission.core.scheduler import MissionScheduler
from swarmware.errors import Conflict
from swarmware.types.mission import MissionPhase, MissionState


def until(core: MissionScheduler, end_ns: int) -> int:
    """Nothing but announcements of the state is due before this instant."""
    while (deadline_ns := core.deadline_ns()) < end_ns:
        assert words(core.on_timer(max(deadline_ns, 0))) == []
    return end_ns


def with_requirement(text: str) -> str:
    return text.replace('{"mission"', '{"requires": ["battery > 20 %"], "mission"', 1)


def test_a_mission_alone_begins_at_once_and_ends() -> None:
    m = Member1()
    assert m.order() == ["state:ready", "state:running", "start a 1"]
    assert m.core.state().active == ("a",)
    assert words(m.core.on_ended(1, result("ok"), "", S)) == ["state:ending", "state:done"]
    state = m.core.state()
    assert (state.state, state.progress_ratio, state.mission, state.hash) == ("done", 1.0, "hop", "01234567")


def test_heartbeat_at_clock_zero_is_due_then() -> None:
    m = Member1()
    now_ns = -10 * S
    m.core.on_timer(now_ns)
    deadlines = []
    while now_ns <= S:
        now_ns = m.core.deadline_ns()
        deadlines.append(now_ns)
        m.core.on_timer(now_ns)
    assert deadlines == sorted(set(deadlines))
    # a write of a change repeats relative to the first, so one can be due at any instant, zero too
    at_zero = Member1()
    at_zero.core.on_timer(-S // 10)
    assert at_zero.core.deadline_ns() == 0


def test_nobody_begins_before_all_have_accepted() -> None:
    m = Member1()
    assert m.order(members=(A, B)) == ["state:ready"]
    assert m.core.state().arrivals[0].barrier == "@start"
    ready = MissionState(7, "01234567", MissionPhase.READY, (), m.core.state().arrivals)
    m.core.on_states([("b", ready, ())], until(m.core, S))
    deadline = until(m.core, S + S // 4)
    assert words(m.core.on_timer(deadline)) == ["state:running", "start a 1"]


def test_nobody_begins_when_one_does_not_answer() -> None:
    m = Member1()
    m.order(members=(A, B))
    assert words(m.core.on_timer(10 * S)) == ["state:idle"]
    state = m.core.state()
    assert state.text == "hop was not started: not all members are ready: without b"
    assert (state.mission, state.epoch) == ("", 7), "nothing was played, and of this run everybody knows it"
    assert m.order(now=11 * S)[0] == "state:ready"


def test_nobody_begins_when_one_has_aborted() -> None:
    m = Member1()
    m.order(members=(A, B))
    assert words(m.core.on_states([("b", MissionState(7, "", MissionPhase.ABORTED), ())], S)) == [
        "state:idle"
    ]


def test_a_failed_mission_lands_and_is_failed() -> None:
    m = Member1()
    m.order()
    assert words(m.core.on_ended(1, result("error:refused"), "no", S)) == [
        "state:ending",
        "state:recovering",
        "start land 2",
    ]
    assert m.core.state().mission == "land"
    assert words(m.core.on_ended(2, result("ok"), "", 2 * S)) == ["state:ending", "state:failed"]
    assert "refused" in m.core.state().text


def test_mission_is_refused_while_built_in_runs() -> None:
    m = Member1()
    m.order()
    m.core.on_ended(1, result("error:refused"), "", S)
    with pytest.raises(Conflict, match="busy: land is recovering"):
        m.order()


def test_a_landing_that_fails_is_said() -> None:
    m = Member1()
    m.order()
    m.core.on_ended(1, result("error:refused"), "", S)
    assert words(m.core.on_ended(2, result("error:blocked"), "", S)) == ["state:ending", "state:failed"]
    assert m.core.state().text.startswith("land: ")


def test_a_ground_station_has_nothing_to_land() -> None:
    m = Member1("gcs")
    m.order()
    assert words(m.core.on_ended(1, result("error:refused"), "", S)) == ["state:ending", "state:failed"]


def test_abort_cancels_waits_and_does_what_operator_says() -> None:
    m = Member1()
    m.order()
    assert words(m.core.on_abort("enough", "hold", S)) == ["state:ending", "cancel 1"]
    assert words(m.core.on_ended(1, result("cancelled"), "", S)) == ["state:recovering", "start hold 2"]
    assert words(m.core.on_abort("again", "", S)) == []
    assert words(m.core.on_abort("down", "land", S)) == ["state:ending", "cancel 2"]
    assert words(m.core.on_ended(2, result("cancelled"), "", S)) == ["state:recovering", "start land 3"]
    assert words(m.core.on_ended(3, result("ok"), "", S)) == ["state:ending", "state:aborted"]


def test_an_abort_before_the_start_moves_nothing() -> None:
    m = Member1()
    m.order(members=(A, B))
    assert words(m.core.on_abort("refused elsewhere", "", S)) == ["state:idle"]
    until(m.core, 60 * S)
    assert m.core.state().text == "hop was not started: refused elsewhere"


def test_landing_ordered_before_start_is_flown() -> None:
    m = Member1()
    m.order(members=(A, B))
    steps = words(m.core.on_abort("operator", "land", S))
    assert steps == ["state:idle", "state:recovering", "start land 1"]


def test_mission_that_comes_to_failed_end_says_why() -> None:
    text = net(
        s="Start>m",
        m={"type": "Barrier", "id": "m", "timeout_s": 5, "next": "e", "nextTimeout": "f"},
        e="End",
        f={"type": "End", "result": "failed"},
    )
    m = Member1("gcs")
    m.order(text, members=(A, B))
    ready = MissionState(7, "01234567", MissionPhase.READY, (), m.core.state().arrivals)
    m.core.on_states([("b", ready, ())], 0)
    m.core.on_timer(until(m.core, S // 4))
    assert m.phase == "running"
    m.core.on_states([("b", MissionState(7, "01234567", MissionPhase.FAILED), ())], 2 * S)
    assert m.phase == "failed"
    assert m.core.state().text == "came to f: m ended with error:broken: without b"


def test_barrier_at_time_out_ends_with_time_out() -> None:
    m = Member1("gcs")
    text = net(
        s="Start>m",
        m={"type": "Barrier", "id": "m", "timeout_s": 1, "next": "e", "nextTimeout": "f"},
        e="End",
        f={"type": "End", "result": "failed"},
    )
    m.order(text, members=(A, B))
    ready = MissionState(7, "01234567", MissionPhase.READY, (), m.core.state().arrivals)
    m.core.on_states([("b", ready, ())], 0)
    m.core.on_timer(until(m.core, S // 4))
    m.core.on_states([("b", MissionState(7, "01234567", MissionPhase.RUNNING), ())], S // 2)
    m.core.on_timer(2 * S)
    assert m.core.state().text == "came to f: m ended with timeout: without b"


def test_operator_may_ask_for_landing_without_mission() -> None:
    m = Member1()
    assert words(m.core.on_abort("operator", "land", S)) == ["state:recovering", "start land 1"]
    assert words(m.core.on_ended(1, result("ok"), "", S)) == ["state:ending", "state:done"]
    assert (m.core.state().mission, m.core.state().text) == ("land", "operator")
    assert words(Member1().core.on_abort("operator", "", S)) == []


def test_an_unknown_built_in_mission_is_refused() -> None:
    with pytest.raises(Conflict, match="'dance': unknown; expected land, hold"):
        Member1().core.on_abort("operator", "dance", S)


@pytest.mark.parametrize("battery", [0.1, None])
def test_mission_whose_requirement_is_not_met_is_refused(battery: float | None) -> None:
    m = Member1()
    m.values.battery = battery
    with pytest.raises(Conflict, match="requirement 'battery > 20 %'"):
        m.order(with_requirement(ARM))


def test_requirement_that_is_no_longer_met_ends_mission() -> None:
    m = Member1()
    m.order(with_requirement(ARM))
    assert words(m.core.on_timer(S)) == []
    m.values.battery = 0.1
    assert words(m.core.on_timer(2 * S)) == ["state:ending", "cancel 1"]
    assert m.core.unmet == ("battery > 20 %",)
    assert words(m.core.on_ended(1, result("cancelled"), "", 2 * S))[-1] == "start land 2"


def test_mission_failing_at_barrier_waits_no_longer() -> None:
    m = Member1()
    text = net(s="Start>w", w="Wait>x", x={"type": "Barrier", "id": "x", "quorum": 2, "next": "e"}, e="End")
    m.order(with_requirement(text), members=(A, B))
    m.core.on_states([("b", MissionState(7, "", MissionPhase.READY, (), m.core.state().arrivals), ())], 0)
    m.core.on_timer(S // 4)
    m.values.battery = 0.1
    assert words(m.core.on_timer(S // 4 + S)) == ["state:ending", "state:recovering", "start land 3"]
    assert m.core.state().arrivals == ()


def test_undecidable_requirement_gets_three_checks() -> None:
    m = Member1()
    m.order(with_requirement(ARM))
    m.values.battery = None
    assert words(m.core.on_timer(S)) == []
    assert words(m.core.on_timer(2 * S)) == []
    assert words(m.core.on_timer(3 * S)) == ["state:ending", "cancel 1"]


def with_pose(text: str) -> str:
    return text.replace('{"mission"', '{"requires": ["age(nav/pose) < 2"], "mission"', 1)


def test_age_excludes_lateness_of_node() -> None:
    m = Member1()
    m.order(with_pose(ARM))
    m.values.pose_age_s = 2.5
    late = until(m.core, S) + S // 2
    assert words(m.core.on_timer(late)) == [], "two turns of half a second each"
    m.values.pose_age_s = 3.1
    assert words(m.core.on_timer(2 * S)) == ["state:ending", "cancel 1"]


def test_age_on_punctual_node_is_unchanged() -> None:
    m = Member1()
    m.order(with_pose(ARM))
    m.values.pose_age_s = 2.5
    assert words(m.core.on_timer(until(m.core, S))) == ["state:ending", "cancel 1"]


def test_unknown_age_stays_unknown_on_late_node() -> None:
    m = Member1()
    m.order(with_pose(ARM))
    m.values.pose_age_s = None
    now = until(m.core, S) + S // 2
    assert words(m.core.on_timer(now)) == []
    assert words(m.core.on_timer(2 * S)) == []
    assert words(m.core.on_timer(3 * S)) == ["state:ending", "cancel 1"]


def test_late_member_waits_longer_at_barrier() -> None:
    text = net(s="Start>x", x={"type": "Barrier", "id": "x", "timeout_s": 60, "next": "e"}, e="End")
    ends: dict[int, int] = {}
    for late_ns in (0, 2 * S):
        m = Member1()
        m.order(text, members=(A, B))
        ready = MissionState(7, "01234567", MissionPhase.READY, (), m.core.state().arrivals)
        m.core.on_states([("b", ready, ())], 0)
        now = m.core.deadline_ns()
        while m.phase != "running":
            m.core.on_timer(now)
            now = max(m.core.deadline_ns(), now)
        m.core.on_timer(now + late_ns)
        while m.phase == "running":
            now = m.core.deadline_ns()
            m.core.on_timer(now)
        ends[late_ns] = now
    assert ends[2 * S] == pytest.approx(ends[0] + 2 * S, abs=S // 5)


def test_late_member_gives_others_more_time() -> None:
    text = net(s="Start>x", x={"type": "Barrier", "id": "x", "timeout_s": 60, "next": "e"}, e="End")
    leads: dict[int, int] = {}
    for late_ns in (0, S):
        m = Member1()
        m.order(text, members=(A, B))
        ready = MissionState(7, "01234567", MissionPhase.READY, (), m.core.state().arrivals)
        m.core.on_states([("b", ready, ())], 0)
        now = m.core.deadline_ns()
        while m.phase != "running":
            m.core.on_timer(now)
            now = max(m.core.deadline_ns(), now)
        now += late_ns
        m.core.on_timer(now)
        there = MissionState(7, "01234567", MissionPhase.RUNNING, ("x",), m.core.state().arrivals)
        m.core.on_states([("b", there, ())], now)
        (result_of_x,) = (one for one in m.core.state().meetings if one.barrier == "x")
        assert result_of_x.leave_ns is not None
        leads[late_ns] = result_of_x.leave_ns - now
    assert leads[0] == S // 4
    assert leads[S] == pytest.approx(S // 4 + 2 * S, abs=S // 5)


@pytest.mark.parametrize(
    ("edges", "expected"),
    [
        ({"nextTimeout": "t", "timeout_s": 99}, "start t 2"),
        ({"nextTimeout": "t", "timeout_s": 99, "on": {"broken": "b"}}, "start b 2"),
        ({"nextError": "b"}, "start b 2"),
        ({}, "start land 2"),
    ],
)
def test_broken_barrier_is_time_out_that_came_early(edges: dict[str, Any], expected: str) -> None:
    m = Member1()
    hold = {"type": "Hold", "next": "e"}
    m.order(
        net(s="Start>x", x={"type": "Barrier", "id": "x", "next": "e", **edges}, t=hold, b=hold, e="End"),
        members=(A, B),
    )
    m.core.on_states([("b", MissionState(7, "", MissionPhase.READY, (), m.core.state().arrivals), ())], 0)
    m.core.on_timer(S // 4)
    assert m.core.state().active == ("x",)
    assert expected in words(m.core.on_states([("b", MissionState(7, "", MissionPhase.FAILED), ())], S))


def test_progress_is_entered_or_from_moving_block() -> None:
    m = Member1()
    m.order()
    before = m.core.state().progress_ratio
    m.core.report(1, 0.5, "half way")
    assert m.core.state().progress_ratio == pytest.approx(before + 0.5 / 3, abs=0.001)
    assert m.core.state().text == "half way"


def test_change_is_sent_three_times_then_each_second() -> None:
    announcer = Announcer()
    state = MissionState(1, "", MissionPhase.RUNNING)
    times = [t for t in range(0, 3 * S, S // 100) if announcer.due(state, t)]
    assert times == [0, S // 10, S // 5, S * 7 // 10, S * 17 // 10, S * 27 // 10]
    assert not announcer.due(MissionState(1, "", MissionPhase.RUNNING, text="far"), 3 * S)
    assert announcer.due(MissionState(1, "", MissionPhase.DONE), 3 * S)
    assert not announcer.due(MissionState(1, "", MissionPhase.FAILED), 3 * S + 1)
    assert announcer.deadline_ns() == 3 * S + S // 10
