"""The player: events and times in, actions out."""

from itertools import count
from typing import Any

import pytest
from tests.unit.mission.nets import choice, net
from tests.unit.mission.results import result

from swarmd.mission.core.player import CANCEL_NS, Player
from swarmd.mission.core.run import (
    CancelBlock,
    EnterBarrier,
    LeaveBarrier,
    PlayEnded,
    PlayResult,
    ProgressStep,
    StartBlock,
)
from swarmware.mission.binding import Binding
from swarmware.mission.field_path import Scalar
from swarmware.mission.loader import load

S = 1_000_000_000


class Values:
    """Fixed resource values."""

    def __init__(self, battery: float | None = 1.0) -> None:
        self.battery = battery

    def value(self, path: str, field: str) -> Scalar | None:
        return self.battery

    def age_s(self, path: str) -> float | None:
        return 0.0


def player(text: str, *, chance: float = 0.0, battery: float | None = 1.0) -> Player:
    return Player(load(text, "m.json", Binding()), Values(battery), lambda: chance, count(1))


def short(actions: list[Any]) -> list[str]:
    """Actions as words, steps left out."""
    found: list[str] = []
    for action in actions:
        match action:
            case StartBlock(token, block):
                found.append(f"start {block.id} {token}")
            case CancelBlock(token):
                found.append(f"cancel {token}")
            case EnterBarrier(token, block, visit):
                found.append(f"barrier {block.id} {token} {visit}")
            case LeaveBarrier(token):
                found.append(f"leave {token}")
            case PlayEnded(result, reason):
                found.append(f"{result}: {reason}" if reason else result)
    return found


def steps(actions: list[Any]) -> list[str]:
    return [f"{a.block} {a.event}" for a in actions if isinstance(a, ProgressStep)]


def branches(after: str) -> Player:
    """Two branches, a block when both have ended, and `after` it the end or the fork again."""
    return player(
        net(
            s="Start>f",
            f="Fork>a,b",
            a={"type": "Arm", "next": "j"},
            b={"type": "Hold", "next": "j"},
            j="Join>c",
            c={"type": "Land", "next": after},
            e="End",
        )
    )


ARM = {"type": "Arm", "next": "e"}


def test_blocks_follow_each_other() -> None:
    p = player(net(s="Start>a", a={"type": "Arm", "next": "b"}, b={"type": "Land", "next": "e"}, e="End"))
    assert short(p.start(0)) == ["start a 1"]
    assert list(p.active) == ["a"]
    assert short(p.on_ended(1, result("ok"), S)) == ["start b 2"]
    last = p.on_ended(2, result("ok"), 2 * S)
    assert short(last) == ["done"]
    assert steps(last) == ["b ok", "e ok"]
    assert list(p.active) == []
    assert p.progress_ratio == 1.0


def test_a_pause_ends_by_itself_at_its_time() -> None:
    p = player(net(s="Start>w", w="Wait>e", e="End"))
    p.start(5 * S)
    assert p.deadline_ns() == 6 * S
    assert p.advance(6 * S - 1) == []
    assert short(p.advance(6 * S)) == ["done"]
    assert p.deadline_ns() is None


def test_a_join_waits_for_all_its_branches() -> None:
    p = branches(after="e")
    assert short(p.start(0)) == ["start a 1", "start b 2"]
    assert short(p.on_ended(2, result("ok"), S)) == []
    assert short(p.on_ended(1, result("ok"), S)) == ["start c 3"]


def test_join_waits_for_all_its_branches_each_time() -> None:
    p = branches(after="f")
    p.start(0)
    p.on_ended(1, result("ok"), S)
    assert short(p.on_ended(2, result("ok"), S)) == ["start c 3"]
    assert short(p.on_ended(3, result("ok"), S)) == ["start a 4", "start b 5"]
    assert short(p.on_ended(4, result("ok"), S)) == [], "the other branch of the first round does not count"
    assert short(p.on_ended(5, result("ok"), S)) == ["start c 6"]


def test_end_cancels_and_awaits_running_blocks() -> None:
    p = player(net(s="Start>f", f="Fork>a,w", a=ARM, w="Wait>e2", e="End", e2="End"))
    p.start(0)
    assert short(p.advance(S)) == ["cancel 1"]
    assert p.stopping
    assert short(p.on_ended(1, result("cancelled"), S)) == ["done"]


def test_end_takes_pauses_and_barriers_along_at_once() -> None:
    barrier = {"type": "Barrier", "id": "x", "next": "e"}
    p = player(net(s="Start>f", f="Fork>b,w,a", b=barrier, w="Wait>e", a=ARM, e="End"))
    assert short(p.start(0)) == ["barrier b 1 1", "start a 3"]
    assert short(p.on_ended(3, result("ok"), 1)) == ["leave 1", "done"]


@pytest.mark.parametrize(
    ("block", "outcome", "expected"),
    [
        ({"on": {"refused": "x"}}, "error:refused", "start x 2"),
        ({"nextError": "x"}, "error:refused", "start x 2"),
        ({}, "error:refused", "failed: a ended with error:refused: no"),
        ({"on": {"no_vehicle": "x"}}, "error:refused", "failed: a ended with error:refused: no"),
    ],
)
def test_error_goes_to_its_successor_or_fails_mission(
    block: dict[str, Any], outcome: str, expected: str
) -> None:
    p = player(net(s="Start>a", a={**ARM, **block}, x={"type": "Hold", "next": "e"}, e="End"))
    p.start(0)
    assert short(p.on_ended(1, result(outcome), 1, "no")) == [expected]


def test_overdue_block_is_cancelled_before_successor() -> None:
    p = player(
        net(
            s="Start>a",
            a={**ARM, "timeout_s": 3, "nextTimeout": "x"},
            x={"type": "Hold", "next": "e"},
            e="End",
        )
    )
    p.start(0)
    assert p.deadline_ns() == 3 * S
    assert short(p.advance(3 * S)) == ["cancel 1"]
    assert short(p.on_ended(1, result("cancelled"), 3 * S + 5)) == ["start x 2"]


def test_time_out_without_successor_fails_mission() -> None:
    p = player(net(s="Start>a", a={**ARM, "timeout_s": 3}, e="End"))
    p.start(0)
    p.advance(3 * S)
    assert short(p.on_ended(1, result("cancelled"), 3 * S)) == ["failed: a ended with timeout"]


def test_uncancellable_block_is_abandoned() -> None:
    p = player(net(s="Start>a", a={**ARM, "timeout_s": 1}, e="End"))
    p.start(0)
    p.advance(S)
    assert p.deadline_ns() == S + CANCEL_NS
    actions = p.advance(S + CANCEL_NS)
    assert short(actions) == ["failed: a ended with timeout"]
    assert "a abandoned" in steps(actions)
    assert p.on_ended(1, result("ok"), 9 * S) == []


@pytest.mark.parametrize(
    ("battery", "expected"),
    [
        (0.1, "start land 1"),
        (0.5, "start hold 1"),
        (0.9, "start fly 1"),
        (None, "failed: d ended with error:unknown_value"),
    ],
)
def test_a_decision_takes_the_first_case_that_holds(battery: float | None, expected: str) -> None:
    cases = [{"if": "battery < 20 %", "next": "land"}, {"if": "battery < 60 %", "next": "hold"}]
    p = player(
        net(
            s="Start>d",
            d={"type": "Decision", "cases": cases, "next": "fly"},
            land={"type": "Land", "next": "e"},
            hold={"type": "Hold", "next": "e"},
            fly={"type": "Goto", "x": 1, "y": 1, "next": "e"},
            e="End",
        ),
        battery=battery,
    )
    assert short(p.start(0)) == [expected]


@pytest.mark.parametrize(("chance", "expected"), [(0.49, "start a 1"), (0.5, "start b 1")])
def test_a_throw_of_dice_follows_the_chance(chance: float, expected: str) -> None:
    p = player(
        net(s="Start>d", d=choice("a", "b"), a=ARM, b={"type": "Hold", "next": "e"}, e="End"), chance=chance
    )
    assert short(p.start(0)) == [expected]


def test_each_visit_of_a_barrier_is_counted() -> None:
    p = player(
        net(s="Start>b", b={"type": "Barrier", "id": "x", "next": "d"}, d=choice("b", "e"), e="End"), chance=0
    )
    assert short(p.start(0)) == ["barrier b 1 1"]
    assert short(p.on_ended(1, result("ok"), 1)) == ["barrier b 2 2"]


def test_an_end_may_say_that_the_mission_failed() -> None:
    p = player(net(s="Start>w", w="Wait>e", e={"type": "End", "result": "failed"}))
    p.start(0)
    assert short(p.advance(S)) == ["failed: came to e"]


def test_stopped_mission_reports_reason_when_quiet() -> None:
    p = player(net(s="Start>f", f="Fork>a,w", a=ARM, w="Wait>e", e="End"))
    p.start(0)
    assert short(p.stop(PlayResult.ABORTED, "operator", 1)) == ["cancel 1"]
    assert p.stop(PlayResult.FAILED, "again", 2) == []
    assert short(p.on_ended(1, result("cancelled"), 3)) == ["aborted: operator"]


def test_unsound_mission_fails_instead_of_doubling_block() -> None:
    p = player(net(s="Start>f", f="Fork>w,v", w="Wait>a", v="Wait>a", a=ARM, e="End"))
    p.start(0)
    actions = p.advance(S)
    assert short(actions) == ["start a 3", "cancel 3"]
    assert short(p.on_ended(3, result("cancelled"), S)) == ["failed: a was entered again while it still ran"]


def test_an_unsound_loop_fails_instead_of_hanging() -> None:
    p = player(net(s="Start>d", d=choice("c", "e"), c=choice("d", "e"), e="End"))
    assert "livelock" in short(p.start(0))[0]


def test_second_block_of_barrier_is_second_meeting() -> None:
    meet = {"type": "Barrier", "id": "m"}
    text = net(
        s="Start>a",
        a={**meet, "next": "b"},
        b={**meet, "next": "c"},
        c={"type": "Barrier", "id": "other", "next": "e"},
        e="End",
    )
    p = player(text)
    assert short(p.start(0)) == ["barrier a 1 1"]
    assert short(p.on_ended(1, result("ok"), S)) == ["barrier b 2 2"]
    assert short(p.on_ended(2, result("ok"), S)) == ["barrier c 3 1"]
