"""Members that wait for each other: what can hang for ever is found, what a time-out ends is not."""

from typing import Any

import pytest
from tests.unit.mission.nets import choice, net
from tests.unit.mission.results import findings

from swarmware.mission.budget import Budget
from swarmware.mission.check import check_folder
from swarmware.mission.finding import Finding
from swarmware.mission.folder import from_files
from swarmware.types.mission import MissionFile


def meet(barrier: str, after: str, **more: Any) -> dict[str, Any]:
    return {"type": "Barrier", "id": barrier, "next": after, **more}


def late(barrier: str, after: str, other: str = "e", **more: Any) -> dict[str, Any]:
    """A barrier with a way out."""
    return meet(barrier, after, timeout_s=9, nextTimeout=other, **more)


def judged(*texts: str, take: tuple[int, ...] = (), budget: Budget | None = None) -> list[Finding]:
    """Findings other than warnings."""
    return [
        finding for finding in findings(*texts, take=take, budget=budget) if finding.severity != "warning"
    ]


ONE_TWO = net(s="Start>a", a=meet("one", "b"), b=meet("two", "e"), e="End")
TWO_ONE = net(s="Start>a", a=meet("two", "b"), b=meet("one", "e"), e="End")
AROUND = net(s="Start>d", d=choice("a", "b"), a=meet("one", "b"), b=meet("two", "e"), e="End")
TWICE = net(s="Start>a", a=meet("one", "b"), b=meet("one", "c"), c=meet("two", "e"), e="End")
LOOP = net(s="Start>a", a=meet("one", "d"), d=choice("a", "b"), b=meet("two", "e"), e="End")
TIMED = net(s="Start>a", a=late("two", "b"), b=late("one", "e"), e="End")
ONE_TWO_TIMED = net(s="Start>a", a=late("one", "b"), b=late("two", "e"), e="End")
RETURNS = net(s="Start>a", a=late("one", "b", "c"), b=meet("two", "e"), c=meet("three", "e"), e="End")
QUORUM = net(s="Start>a", a=meet("one", "b", quorum=2), b=meet("two", "e"), e="End")

HANGS: dict[str, tuple[tuple[str, ...], tuple[int, ...]]] = {
    "crossed order": ((ONE_TWO, TWO_ONE), (1, 1)),
    "a way around a barrier": ((AROUND, ONE_TWO), (1, 1)),
    "a way around it for two of one role": ((AROUND,), (0,)),
    "one more visit in one role": ((TWICE, ONE_TWO), (1, 1)),
    "a loop in one role only": ((LOOP, ONE_TWO), (1, 1)),
    "a loop in each, left by chance": ((LOOP,), (2,)),
    "the alternative of a time-out waits again": ((RETURNS, RETURNS), (1, 1)),
}
FINE: dict[str, tuple[tuple[str, ...], tuple[int, ...]]] = {
    "the same order": ((ONE_TWO, ONE_TWO, ONE_TWO), (1, 0, 2)),
    "the same id twice in each": ((TWICE, TWICE), (1, 0)),
    "crossed order with time-outs": ((ONE_TWO_TIMED, TIMED), (1, 1)),
    "a quorum lets the others pass": ((QUORUM, QUORUM, QUORUM), (1, 1, 1)),
    "a way around to the end": (
        (net(s="Start>d", d=choice("a", "e"), a=meet("one", "e"), e="End"),),
        (0,),
    ),
}


@pytest.mark.parametrize("name", HANGS)
def test_endless_wait_is_refused_with_its_place(name: str) -> None:
    texts, take = HANGS[name]
    (finding,) = judged(*texts, take=take)
    assert (finding.severity, finding.rule) == ("error", "barrier")
    assert "wait for each other for ever" in finding.message
    assert finding.pointer.startswith("/mission/")
    assert finding.line == 1


@pytest.mark.parametrize("name", FINE)
def test_what_always_goes_on_is_sound(name: str) -> None:
    texts, take = FINE[name]
    assert judged(*texts, take=take) == []


ONCE = net(s="Start>a", a=meet("x", "w"), w="Wait>e", e="End")
BOTH = net(s="Start>a", a=meet("x", "b"), b=meet("x", "e"), e="End")
ONCE_OF_TWO = ONCE.replace('"x"', '"x", "quorum": 2')
BOTH_OF_TWO = BOTH.replace('"x"', '"x", "quorum": 2')
BOTH_TIMED = net(s="Start>a", a=meet("x", "b"), b=late("x", "e"), e="End")
ROUND = net(s="Start>a", a=meet("x", "d"), d=choice("a", "e"), e="End")
SIX = net(
    s="Start>b0", **{f"b{n}": meet("x", f"b{n + 1}" if n < 5 else "e", quorum=1) for n in range(6)}, e="End"
)
BESIDE = net(
    s="Start>f", f="Fork>a,b", a=meet("x", "c"), c=meet("x", "j"), b=late("y", "j"), j="Join>e", e="End"
)
BESIDE_LESS = BESIDE.replace('"x", "next": "c"', '"x", "next": "j"').replace(
    '"c": {"type": "Barrier", "id": "x", "next": "j"}, ', ""
)
EARLY = net(s="Start>f", f="Fork>a,w", a=meet("x", "j"), w="Wait>e", j="Join>e", e="End")

FAILS: dict[str, tuple[tuple[str, ...], tuple[int, ...], str]] = {
    "one visit more in one role": ((BOTH, ONCE), (1, 1), "error"),
    "one visit more in a role of any number": ((ONCE, BOTH), (0, 0), "error"),
    "one visit more than the quorum has members for": ((BOTH_OF_TWO, ONCE_OF_TWO), (1, 2), "error"),
    "one visit more than a quorum may have members for": ((BOTH_OF_TWO, ONCE_OF_TWO), (0, 2), "warning"),
    "crossed order with a time-out in one role": ((ONE_TWO, TIMED), (1, 1), "error"),
    "one visit more beside a barrier with a time-out": ((BESIDE, BESIDE_LESS), (1, 1), "error"),
    "a loop that may go round more often": ((ROUND, ROUND), (1, 1), "warning"),
    "a loop that may go round more often than the other role": ((ROUND, ONCE), (1, 1), "warning"),
    "a way around to the end": (
        (net(s="Start>d", d=choice("a", "e"), a=meet("x", "e"), e="End"), ONCE),
        (1, 1),
        "warning",
    ),
    "an End that may come before the barrier opens": ((EARLY, ONCE), (1, 1), "warning"),
}
FULFILLED: dict[str, tuple[tuple[str, ...], tuple[int, ...]]] = {
    "the same number of visits": ((BOTH, BOTH), (1, 0)),
    "one visit more, with a successor for it": ((BOTH_TIMED, ONCE), (1, 1)),
    "one visit more among enough members for the quorum": ((BOTH_OF_TWO, ONCE_OF_TWO), (2, 1)),
    "six visits of which each opens for one": ((SIX, SIX), (1, 1)),
}


def told(texts: tuple[str, ...], take: tuple[int, ...]) -> list[Finding]:
    return [finding for finding in findings(*texts, take=take) if finding.rule == "unequal-visits"]


@pytest.mark.parametrize("name", FAILS)
def test_failure_in_every_run_is_error(name: str) -> None:
    texts, take, severity = FAILS[name]
    (finding,) = told(texts, take)
    assert finding.severity == severity
    assert ("fails in every run" in finding.message) == (severity == "error")
    assert finding.trace[-1].endswith("broke")
    assert any("ends" in step for step in finding.trace)


@pytest.mark.parametrize("name", FULFILLED)
def test_equal_visits_do_not_fail(name: str) -> None:
    texts, take = FULFILLED[name]
    assert told(texts, take) == []


def test_way_to_failure_names_choices_and_role() -> None:
    (finding,) = told((ROUND, ONCE), (1, 1))
    assert finding.trace == ("'x' opened", "a: d:true", "b: ends", "'x' broke")
    assert "role 'a' fails in this run: 'x' broke: b will not come to it any more" in finding.message


def test_the_way_to_a_hang_names_the_meetings() -> None:
    texts, take = HANGS["one more visit in one role"]
    (finding,) = judged(*texts, take=take)
    assert "a at 'one' (b), b at 'two' (b)" in finding.message
    assert finding.trace == ("'one' opened",)


def test_two_branches_at_one_barrier_are_refused() -> None:
    text = net(s="Start>f", f="Fork>a,b", a=meet("one", "j"), b=meet("one", "j"), j="Join>e", e="End")
    (finding,) = judged(text)
    assert "two branches wait there at the same time" in finding.message


def test_a_quorum_above_the_members_is_refused() -> None:
    text = net(s="Start>a", a=meet("one", "e", quorum=4), e="End")
    found = judged(text, text, take=(1, 2))
    assert len(found) == 2
    assert "a quorum of 4, but its roles take 3 members" in found[0].message
    assert judged(text, text, take=(1, 0)) == []


def test_barrier_without_broken_exit_is_warning() -> None:
    manifest = '[[roles]]\nname = "a"\nfile = "a.json"\nkinds = ["uav"]\n'
    files = [MissionFile("mission.toml", f'name = "x"\n{manifest}'), MissionFile("a.json", ONE_TWO)]
    found = check_folder(from_files(files, ""))
    assert [(f.severity, f.rule, f.pointer) for f in found] == [
        ("warning", "broken-barrier", "/mission/a"),
        ("warning", "broken-barrier", "/mission/b"),
    ]


def test_ensemble_beyond_state_budget_is_refused() -> None:
    body: dict[str, Any] = {"s": "Start>d0", "e": "End"}
    for n in range(10):
        body[f"d{n}"] = choice(f"m{n}", f"d{n + 1}" if n < 9 else "e")
        body[f"m{n}"] = late(f"x{n}", f"d{n + 1}" if n < 9 else "e", f"d{(n * 3) % 10}")
    (finding,) = judged(*[net(**body)] * 4, take=(0,) * 4, budget=Budget(1 << 20))
    assert (finding.severity, finding.rule) == ("unknown", "too-large")
