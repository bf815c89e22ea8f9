"""Barriers between members that hear each other at once and tell the same time."""

import pytest
from tests.unit.mission.results import result

from swarmd.mission.core.barrier import Barriers, BarrierSpec, Passed
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import Arrival, BarrierResult, Member, MissionPhase, MissionState

S = 1_000_000_000
LEAD = S // 4
NAMES = ("a", "b", "c")
MEMBERS = tuple(Member(name, "role", PlatformKind.UAV) for name in NAMES)
GATE = BarrierSpec("x", 1, timeout_s=10.0)


class Ensemble:
    """Members on one clock; `talk` lets all hear all."""

    def __init__(self, members: tuple[Member, ...] = MEMBERS) -> None:
        self.of = {m.platform: Barriers(m.platform, members, 7, 3 * S, lambda _: LEAD) for m in members}
        for barriers in self.of.values():
            barriers.expect_all(0)

    def board(self, name: str, state: str = "running") -> MissionState:
        barriers = self.of[name]
        return MissionState(7, "h", MissionPhase(state), (), barriers.arrivals, barriers.results)

    def talk(self, now_ns: int, silent: tuple[str, ...] = (), **states: str) -> dict[str, list[Passed]]:
        """All members receive all states; returns the members that passed."""
        boards = {name: self.board(name, states.get(name, "running")) for name in self.of}
        for hearer, barriers in self.of.items():
            for name, board in boards.items():
                if name != hearer and name not in silent:
                    barriers.on_state(name, board, board.meetings, now_ns)
        return {name: barriers.advance(now_ns) for name, barriers in self.of.items()}

    def arrive(self, *names: str, gate: BarrierSpec = GATE, now_ns: int = 0) -> None:
        for name in names:
            self.of[name].arrive(1, gate, now_ns)


def outcomes(passed: dict[str, list[Passed]]) -> dict[str, str]:
    return {name: p.result.label for name, found in passed.items() for p in found}


def test_all_leave_at_time_first_member_names() -> None:
    e = Ensemble()
    e.arrive("a", "b", "c")
    assert outcomes(e.talk(S)) == {}
    assert e.of["a"].results == (BarrierResult("x", 1, S + LEAD, 0),)
    assert outcomes(e.talk(S + 1)) == {}
    assert {b.deadline_ns() for b in e.of.values()} == {S + LEAD}
    assert all(b.advance(S + LEAD - 1) == [] for b in e.of.values())
    assert outcomes({n: b.advance(S + LEAD) for n, b in e.of.items()}) == dict.fromkeys(NAMES, "ok")


def test_nobody_leaves_before_all_are_there() -> None:
    e = Ensemble()
    e.arrive("a", "b")
    e.talk(S)
    assert e.of["a"].results == ()
    assert e.of["a"].missing(S) == ("c",)


def test_a_quorum_opens_the_barrier_and_latecomers_pass() -> None:
    e = Ensemble()
    gate = BarrierSpec("x", 1, quorum=2, timeout_s=10.0)
    e.arrive("b", "c", gate=gate)
    e.talk(S)
    e.talk(S + 1)
    assert outcomes(e.talk(S + LEAD)) == {"b": "ok", "c": "ok"}
    e.arrive("a", gate=gate, now_ns=2 * S)
    assert outcomes(e.talk(2 * S)) == {"a": "ok"}


def test_only_the_named_roles_meet() -> None:
    members = (
        Member("a", "lead", PlatformKind.UGV),
        Member("b", "air", PlatformKind.UAV),
        Member("c", "air", PlatformKind.UAV),
    )
    e = Ensemble(members)
    e.arrive("b", "c", gate=BarrierSpec("x", 1, roles=("air",)))
    e.talk(S)
    e.talk(S + 1)
    assert outcomes(e.talk(S + LEAD)) == {"b": "ok", "c": "ok"}


def test_one_time_out_breaks_barrier_for_all() -> None:
    e = Ensemble()
    e.arrive("a")
    e.arrive("b", now_ns=5 * S)
    assert e.of["a"].deadline_ns() == 3 * S + 1  # silence of the others would break it earlier
    for second in range(1, 10):
        assert outcomes(e.talk(second * S)) == {}
    assert e.of["a"].advance(10 * S) == [Passed(1, result("timeout"), "without c")]
    assert outcomes(e.talk(10 * S + 1)) == {"b": "error:broken"}
    e.arrive("c", now_ns=11 * S)
    assert outcomes(e.talk(11 * S)) == {"c": "error:broken"}


def test_silent_member_breaks_barrier() -> None:
    e = Ensemble()
    e.arrive("a", "b")
    for second in (1, 2, 3):
        assert outcomes(e.talk(second * S, silent=("c",))) == {}
    assert e.of["a"].advance(3 * S + 1) == [Passed(1, result("error:broken"), "without c")]


def test_member_with_living_computer_gets_triple_time() -> None:
    e = Ensemble()
    e.arrive("a", "b")
    for second in range(1, 9):
        e.of["a"].on_alive("c", second * S)
        e.of["b"].on_alive("c", second * S)
        assert outcomes(e.talk(second * S, silent=("c",))) == {}
    assert e.of["a"].advance(9 * S) == []
    assert outcomes({"a": e.of["a"].advance(9 * S + 1)}) == {"a": "error:broken"}


def test_member_that_failed_breaks_barrier_at_once() -> None:
    e = Ensemble()
    e.arrive("a", "b")
    assert outcomes(e.talk(S, c="recovering")) == {
        "a": "error:broken",
        "b": "error:broken",
    }


def test_a_member_that_started_anew_breaks_the_barrier() -> None:
    e = Ensemble()
    e.talk(S)
    e.arrive("a", "b")
    for name in ("a", "b"):
        e.of[name].on_state("c", MissionState(0, "", MissionPhase.IDLE), (), 2 * S)
    assert outcomes({n: e.of[n].advance(2 * S) for n in ("a", "b")}) == dict.fromkeys("ab", "error:broken")


def test_the_state_of_another_run_is_no_arrival() -> None:
    e = Ensemble()
    e.arrive("a", "b")
    old = MissionState(6, "h", MissionPhase.RUNNING, (), (Arrival("x", 1),), (BarrierResult("x", 1, 5, 0),))
    e.of["a"].on_state("c", old, old.meetings, S)
    e.talk(S, silent=("c",))
    assert e.of["a"].results == ()


def test_next_member_opens_after_loss_of_first() -> None:
    e = Ensemble()
    gate = BarrierSpec("x", 1, quorum=2)
    e.arrive("b", "c", gate=gate)
    e.talk(S, a="failed")
    e.talk(S + 1)
    assert outcomes(e.talk(S + LEAD)) == {"b": "ok", "c": "ok"}


def test_late_member_learns_time_from_others() -> None:
    e = Ensemble()
    e.arrive("a", "b", "c")
    e.talk(S, silent=())
    board = e.board("a")
    e.of["b"].on_state("a", board, board.meetings, S)
    told = e.board("b")
    assert told.meetings == (BarrierResult("x", 1, S + LEAD, 0),)
    e.of["c"].on_state("b", told, told.meetings, S + 2)
    assert e.of["c"].deadline_ns() == S + LEAD


def test_first_members_direct_statement_prevails() -> None:
    e = Ensemble()
    c = e.of["c"]
    c.arrive(1, GATE, 0)
    c.on_state("b", e.board("b"), (BarrierResult("x", 1, 500, 1),), 1)
    assert c.deadline_ns() == 500
    c.on_state("b", e.board("b"), (BarrierResult("x", 1, 600, 0),), 2)
    assert c.deadline_ns() == 600
    c.on_state("a", e.board("a"), (BarrierResult("x", 1, 601, 0),), 3)
    assert c.deadline_ns() == 601
    c.on_state("b", e.board("b"), (BarrierResult("x", 1, 700, 0),), 4)
    assert c.deadline_ns() == 601
    c.on_state("b", e.board("b"), (BarrierResult("x", 1, None, 1),), 5)
    assert c.advance(5) == [Passed(1, result("error:broken"), "without a, b")]


def test_barrier_in_loop_opens_at_each_visit() -> None:
    e = Ensemble()
    for visit in (1, 2):
        now = visit * 10 * S
        e.arrive(*NAMES, gate=BarrierSpec("x", visit), now_ns=now)
        e.talk(now)
        e.talk(now + 1)
        assert outcomes(e.talk(now + LEAD)) == dict.fromkeys(NAMES, "ok")


def test_a_member_alone_does_not_wait() -> None:
    alone = Barriers("a", MEMBERS[:1], 7, 3 * S, lambda _: LEAD)
    alone.arrive(1, GATE, 5)
    assert alone.advance(5) == [Passed(1, result("ok"))]


def test_a_stranger_is_not_listened_to() -> None:
    e = Ensemble()
    e.arrive("a")
    e.of["a"].on_state("z", MissionState(7, "h", MissionPhase.RUNNING), (BarrierResult("x", 1, 5, 0),), 5)
    assert e.of["a"].advance(6) == []


def with_a_station(strict: frozenset[str] = frozenset()) -> Ensemble:
    members = (
        Member("a", "air", PlatformKind.UAV),
        Member("b", "air", PlatformKind.UAV),
        Member("c", "control", PlatformKind.GCS),
    )
    e = Ensemble(members)
    e.of = {m.platform: Barriers(m.platform, members, 7, 3 * S, lambda _: LEAD, strict) for m in members}
    for barriers in e.of.values():
        barriers.expect_all(0)
    return e


def test_ground_station_that_is_there_is_waited_for() -> None:
    e = with_a_station()
    e.arrive("a", "b")
    assert outcomes(e.talk(S)) == {}
    assert e.of["a"].missing(S) == ("c",)
    assert e.of["a"].results == ()


def test_a_ground_station_that_vanished_is_not_needed() -> None:
    e = with_a_station()
    e.arrive("a", "b")
    for now in (S, 2 * S, 3 * S, 3 * S + 1, 3 * S + 2):
        assert outcomes(e.talk(now, silent=("c",))) == {}
    assert e.of["a"].missing(3 * S + 2) == ()
    assert outcomes(e.talk(3 * S + 2 + LEAD, silent=("c",))) == {"a": "ok", "b": "ok"}


@pytest.mark.parametrize("state", ["idle", "failed", "done", "recovering"])
def test_finished_ground_station_is_not_needed(state: str) -> None:
    e = with_a_station()
    e.arrive("a", "b")
    e.talk(S, c=state)
    e.talk(S + 1, c=state)
    assert outcomes(e.talk(S + 1 + LEAD, c=state)) == {"a": "ok", "b": "ok"}


def test_abort_at_ground_station_holds_for_all() -> None:
    e = with_a_station()
    e.arrive("a", "b")
    assert outcomes(e.talk(S, c="aborted")) == {"a": "error:broken", "b": "error:broken"}


def test_barrier_given_up_by_station_is_not_broken() -> None:
    e = with_a_station()
    c = e.of["c"]
    c.arrive(1, BarrierSpec("x", 1, timeout_s=5.0), 0)
    for name in ("a", "b"):
        c.on_alive(name, 5 * S)
    assert c.advance(5 * S)[0].result.label in {"timeout", "error:broken"}
    assert c.results[0].leave_ns is None
    e.arrive("a", "b", now_ns=5 * S)
    for now in (5 * S, 5 * S + 1):
        assert outcomes(e.talk(now, c="failed")) == {}
    assert outcomes(e.talk(5 * S + 1 + LEAD, c="failed")) == {"a": "ok", "b": "ok"}


def test_loss_of_named_ground_station_breaks_barrier() -> None:
    e = with_a_station(frozenset({"x"}))
    e.arrive("a", "b")
    for now in (S, 2 * S, 3 * S):
        e.talk(now, silent=("c",))
    assert outcomes(e.talk(3 * S + 1, silent=("c",))) == {"a": "error:broken", "b": "error:broken"}


def test_harmless_loss_is_no_longer_deadline() -> None:
    e = with_a_station()
    a = e.of["a"]
    a.arrive(1, BarrierSpec("x", 1), 0)
    for second in range(1, 6):
        a.on_state("b", e.board("b"), (), second * S)
    assert a.advance(5 * S) == []
    deadline = a.deadline_ns()
    assert deadline is not None
    assert deadline > 5 * S


def test_late_learning_member_takes_alternative() -> None:
    e = Ensemble()
    e.arrive("a", "b", "c")
    e.talk(S)
    opening = e.board("a")
    # the others do not know yet
    assert outcomes({n: b.advance(S + LEAD) for n, b in e.of.items()}) == {"a": "ok"}
    e.of["b"].on_state("a", opening, opening.meetings, S + LEAD)
    assert e.of["b"].advance(S + LEAD + S // 2) == [Passed(1, result("ok"))]
    e.of["c"].on_state("a", opening, opening.meetings, 2 * S)
    assert e.of["c"].advance(2 * S) == [Passed(1, result("error:broken"), "the others left 0.8 s ago")]


def test_forgotten_meeting_is_over_for_latecomer() -> None:
    e = Ensemble()
    gates = [BarrierSpec("x", visit, quorum=2) for visit in range(1, 30)]
    for visit, gate in enumerate(gates, 1):
        e.arrive("b", "c", gate=gate, now_ns=visit * S)
        e.talk(visit * S)
        e.talk(visit * S + 1)
        assert outcomes(e.talk(visit * S + LEAD)) == {"b": "ok", "c": "ok"}
    e.arrive("a", gate=gates[0], now_ns=30 * S)
    assert outcomes(e.talk(30 * S)) == {"a": "error:broken"}


def test_member_at_later_visit_ends_earlier_wait() -> None:
    e = Ensemble()
    e.arrive("a", gate=BarrierSpec("x", 2))
    e.arrive("b", "c", gate=BarrierSpec("x", 1))
    assert outcomes(e.talk(S)) == {"b": "error:broken", "c": "error:broken"}


def test_own_deafness_is_not_others_silence() -> None:
    e = Ensemble()
    e.arrive("a", "b")
    late = e.of["a"]
    late.on_loop_delay(2 * S)
    assert late.advance(5 * S - 1) == [], "three seconds without the two that it was late"
    assert [passed.result.label for passed in late.advance(5 * S + 1)] == ["error:broken"]
    assert [passed.result.label for passed in e.of["b"].advance(3 * S + 1)] == ["error:broken"]


def test_states_missed_while_deaf_are_not_missing() -> None:
    ends_ns = []
    for late_ns in (0, 2 * S):
        e = Ensemble()
        e.arrive("a", gate=BarrierSpec("x", 1, timeout_s=60.0))
        late = e.of["a"]
        late.on_loop_delay(late_ns)
        now_ns = 0
        while not late.advance(now_ns):
            now_ns += S // 2
            for other in ("b", "c"):
                late.on_alive(other, now_ns)
        ends_ns.append(now_ns)
    assert ends_ns[1] - ends_ns[0] == 2 * S
