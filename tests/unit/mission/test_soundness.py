"""Soundness: what is found in a mission's net, with the shortest way to it."""

import json
from itertools import count
from typing import Any

import pytest
from tests.unit.mission.nets import choice, lattice, net

from swarmd.mission.core.player import Player
from swarmd.mission.core.run import PlayEnded, PlayResult
from swarmware.mission import soundness
from swarmware.mission.binding import Binding
from swarmware.mission.budget import Budget
from swarmware.mission.check import check_text
from swarmware.mission.finding import Remark
from swarmware.mission.loader import load

HERE = Binding()


def remarks(text: str, budget: Budget | None = None) -> list[Remark]:
    return soundness.check(load(text, "m.json", HERE), budget)


SOUND = {
    "line": net(s="Start>w", w="Wait>e", e="End"),
    "fork and join": net(s="Start>f", f="Fork>a,b", a="Wait>j", b="Wait>j", j="Join>e", e="End"),
    "fork into join": net(s="Start>f", f="Fork>a,j", a="Wait>j", j="Join>e", e="End"),
    "nested": net(
        s="Start>f",
        f="Fork>a,g",
        g="Fork>b,c",
        b="Wait>k",
        c="Wait>k",
        k="Join>j",
        a="Wait>j",
        j="Join>e",
        e="End",
    ),
    "merge": net(s="Start>d", d=choice("a", "b"), a="Wait>c", b="Wait>c", c="Wait>e", e="End"),
    "loop with a way out": net(s="Start>w", w="Wait>d", d=choice("w", "e"), e="End"),
    "two outcomes share a place of the join": net(
        s="Start>f",
        f="Fork>a,b",
        a={"type": "Arm", "next": "j", "nextTimeout": "j", "nextError": "j"},
        b="Wait>j",
        j="Join>e",
        e="End",
    ),
    "any branch ends all at one End": net(s="Start>f", f="Fork>a,b", a="Wait>e", b="Wait>e", e="End"),
    "a branch ends all": net(s="Start>f", f="Fork>a,b", a="Wait>e", b="Wait>e2", e="End", e2="End"),
}


@pytest.mark.parametrize("name", SOUND)
def test_a_sound_mission_has_no_remarks(name: str) -> None:
    assert remarks(SOUND[name]) == []


def test_a_block_nobody_leads_to_is_dead() -> None:
    (remark,) = remarks(net(s="Start>e", e="End", w="Wait>e"))
    assert (remark.rule, remark.block) == ("dead-block", "w")


def test_join_of_alternatives_is_deadlock_with_its_way() -> None:
    text = net(s="Start>d", d=choice("a", "b"), a="Wait>j", b="Wait>j", j="Join>e", e="End")
    found = remarks(text)
    assert found[0].rule == "deadlock"
    assert found[0].block == "j"
    assert found[0].trace in {("s", "d:true", "a"), ("s", "d:false", "b")}


def test_join_behind_optional_timeout_is_deadlock() -> None:
    text = net(
        s="Start>f",
        f="Fork>a,b",
        a={"type": "Arm", "next": "j", "nextTimeout": "w"},
        w="Wait>w2",
        w2="Wait>k",
        b="Wait>j",
        k="Join>e",
        j="Join>k",
        e="End",
    )
    found = remarks(text)
    assert found[0].rule == "deadlock"
    assert "waits for ever for 'w2'" in found[0].message
    assert found[0].trace[-1] == "j"


def test_branch_that_never_joins_or_ends_is_found() -> None:
    text = net(s="Start>d", d=choice("a", "e"), a="Wait>b", b="Wait>a", e="End")
    (remark,) = remarks(text)
    assert remark.rule == "never-ends"
    assert remark.trace[:2] == ("s", "d:true")


def test_two_tokens_in_one_block_are_found() -> None:
    text = net(s="Start>f", f="Fork>a,b", a="Wait>c", b="Wait>c", c="Wait>e", e="End")
    remark = remarks(text)[0]
    assert (remark.rule, remark.block) == ("two-tokens", "c")
    assert len(remark.trace) == 4


def test_second_token_is_no_deadlock_of_first_one() -> None:
    text = net(s="Start>f", f="Fork>a,b,c", a="Wait>b", b="Wait>j", c="Wait>j", j="Join>e", e="End")
    assert {remark.rule for remark in remarks(text)} == {"two-tokens"}


@pytest.mark.parametrize(
    ("text", "rules"),
    [
        (net(s="Start>f", f="Fork>d,e", d=choice("e", "e"), e="End"), []),
        (net(s="Start>f", f="Fork>e,d", d=choice("e", "e"), e="End"), []),
        (net(s="Start>f", f="Fork>w,e", w="Wait>e", e="End"), [("cut-short", "w")]),
        (net(s="Start>f", f="Fork>e,w", w="Wait>e", e="End"), [("cut-short", "w")]),
        (net(s="Start>f", f="Fork>m,e", m="Hold>e", e="End"), [("cut-short", "m")]),
    ],
    ids=["a decision", "a decision last", "a pause", "a pause last", "a motion"],
)
def test_branch_beside_end_is_cleared_by_it(text: str, rules: list[tuple[str, str]]) -> None:
    found = remarks(text)
    assert [(remark.rule, remark.block) for remark in found] == rules
    assert all(remark.severity == "warning" for remark in found)


def test_block_ended_by_end_names_it() -> None:
    (remark,) = remarks(net(s="Start>f", f="Fork>w,e", w="Wait>e", e="End"))
    assert "'w' never completes: the End 'e' comes at the same instant" in remark.message
    found = remarks(net(s="Start>f", f="Fork>w,e", w="Wait>v", v="Wait>e", e="End"))
    assert [(r.severity, r.rule, r.block) for r in found] == [
        ("error", "dead-block", "v"),
        ("warning", "cut-short", "w"),
    ]


def test_a_loop_that_never_rests_is_found() -> None:
    text = net(s="Start>d", d=choice("g", "e"), g=choice("d", "e"), e="End")
    assert [r.rule for r in remarks(text)] == ["livelock"]
    assert "d → g → d" in remarks(text)[0].message


def decisions(count: int, last: str) -> dict[str, Any]:
    return {f"d{n}": choice(f"d{n + 1}" if n < count - 1 else last, "e") for n in range(count)}


@pytest.mark.parametrize("pause", [{"s": 0}, {"ms": 0}, {"ms": 3}])
def test_loop_of_decisions_and_empty_pauses_never_rests(pause: dict[str, Any]) -> None:
    text = net(s="Start>w", w={"type": "Wait", **pause, "next": "d"}, d=choice("w", "e"), e="End")
    (remark,) = remarks(text)
    assert remark.rule == "livelock"
    assert "w → d → w" in remark.message
    assert remarks(text.replace(json.dumps(pause)[1:-1], '"ms": 10')) == []


def test_excess_of_instant_blocks_is_found() -> None:
    text = net(s="Start>w", w="Wait>d0", **decisions(1_500, "e"), e="End")
    assert [(r.rule, r.block) for r in remarks(text)] == [("instant-chain", "w")]
    wide = {f"w{n}": "Wait>e" for n in range(1_500)}
    text = net(s="Start>f", f="Fork>" + ",".join(wide), **wide, e="End")
    assert remarks(text, Budget(0))[0].rule == "instant-chain"


def test_player_executes_whatever_check_accepts() -> None:
    fits = net(s="Start>w", w="Wait>d0", **decisions(996, "e"), e="End")
    assert remarks(fits) == []
    player = Player(load(fits, "m.json", HERE), None, lambda: 0.4, count(1))  # type: ignore[arg-type]  # no conditions
    player.start(0)
    assert player.advance(1_000_000_000)[-1] == PlayEnded(PlayResult.DONE)
    assert [r.rule for r in remarks(net(s="Start>w", w="Wait>d0", **decisions(998, "e"), e="End"))] == [
        "instant-chain"
    ]


def test_motion_cut_short_by_end_is_warning() -> None:
    text = net(
        s="Start>f",
        f="Fork>m,w",
        m={"type": "Goto", "x": 1, "y": 1, "next": "e"},
        w="Wait>e2",
        e="End",
        e2="End",
    )
    (remark,) = remarks(text)
    assert (remark.severity, remark.rule, remark.block) == ("warning", "cut-short", "m")


def test_too_many_states_give_no_answer() -> None:
    text = lattice(5, 2)
    assert remarks(text) == []
    (remark,) = remarks(text, Budget(100_000))
    assert (remark.severity, remark.rule) == ("unknown", "too-large")


def test_finding_stands_at_line_of_its_block() -> None:
    text = '{"mission": {\n"s": {"type": "Start", "next": "e"},\n"e": {"type": "End"},\n'
    text += '"w":\n {"type": "Wait", "s": 1, "next": "e"}}}'
    (finding,) = check_text(text, "m.json", HERE)[1]
    assert (finding.line, finding.pointer) == (5, "/mission/w")
