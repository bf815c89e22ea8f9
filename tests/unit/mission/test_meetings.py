"""Members that wait for each other: what can hang for ever is found, what a time-out ends is not."""

from typing import Any

import pytest
from tests.unit.mission.nets import choice, net

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
    """Roles a, b, … with these missions; one platform each unless `take` says otherwise."""
    names = "abcd"[: len(texts)]
    manifest = 'name = "trial"\n' + "".join(
        f'[[roles]]\nname = "{name}"\nfile = "{name}.json"\nkinds = ["uav"]\ntake = {number}\n'
        for name, number in zip(names, take or (1,) * len(texts), strict=True)
    )
    files = [MissionFile(f"{name}.json", text) for name, text in zip(names, texts, strict=True)]
    found = check_folder(from_files([MissionFile("mission.toml", manifest), *files], ""), budget=budget)
    return [finding for finding in found if finding.severity != "warning"]


ONE_TWO = net(s="Start>a", a=meet("one", "b"), b=meet("two", "e"), e="End")
TWO_ONE = net(s="Start>a", a=meet("two", "b"), b=meet("one", "e"), e="End")
AROUND = net(s="Start>d", d=choice("a", "b"), a=meet("one", "b"), b=meet("two", "e"), e="End")
TWICE = net(s="Start>a", a=meet("one", "b"), b=meet("one", "c"), c=meet("two", "e"), e="End")
LOOP = net(s="Start>a", a=meet("one", "d"), d=choice("a", "b"), b=meet("two", "e"), e="End")
TIMED = net(s="Start>a", a=late("two", "b"), b=late("one", "e"), e="End")
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
    "crossed order with time-outs": ((ONE_TWO, TIMED), (1, 1)),
    "a quorum lets the others pass": ((QUORUM, QUORUM, QUORUM), (1, 1, 1)),
    "a way around to the end": (
        (net(s="Start>d", d=choice("a", "e"), a=meet("one", "e"), e="End"),),
        (0,),
    ),
}


@pytest.mark.parametrize("name", HANGS)
def test_what_can_wait_for_ever_is_refused_with_who_waits_where(name: str) -> None:
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


def test_the_way_to_a_hang_names_the_meetings() -> None:
    texts, take = HANGS["one more visit in one role"]
    (finding,) = judged(*texts, take=take)
    assert "a at 'one' (b), b at 'two' (b)" in finding.message
    assert finding.trace == ("'one' opened",)


def test_two_branches_at_one_barrier_at_the_same_time_are_one_too_many() -> None:
    text = net(s="Start>f", f="Fork>a,b", a=meet("one", "j"), b=meet("one", "j"), j="Join>e", e="End")
    (finding,) = judged(text)
    assert "two branches wait there at the same time" in finding.message


def test_a_quorum_above_the_members_is_refused() -> None:
    text = net(s="Start>a", a=meet("one", "e", quorum=4), e="End")
    found = judged(text, text, take=(1, 2))
    assert len(found) == 2
    assert "a quorum of 4, but its roles take 3 members" in found[0].message
    assert judged(text, text, take=(1, 0)) == []


def test_a_barrier_without_a_way_on_when_it_breaks_is_a_warning() -> None:
    manifest = '[[roles]]\nname = "a"\nfile = "a.json"\nkinds = ["uav"]\n'
    files = [MissionFile("mission.toml", f'name = "x"\n{manifest}'), MissionFile("a.json", ONE_TWO)]
    found = check_folder(from_files(files, ""))
    assert [(f.severity, f.rule, f.pointer) for f in found] == [
        ("warning", "broken-barrier", "/mission/a"),
        ("warning", "broken-barrier", "/mission/b"),
    ]


def test_an_ensemble_with_more_states_than_the_budget_is_not_flown() -> None:
    body: dict[str, Any] = {"s": "Start>d0", "e": "End"}
    for n in range(10):
        body[f"d{n}"] = choice(f"m{n}", f"d{n + 1}" if n < 9 else "e")
        body[f"m{n}"] = late(f"x{n}", f"d{n + 1}" if n < 9 else "e", f"d{(n * 3) % 10}")
    (finding,) = judged(*[net(**body)] * 4, take=(0,) * 4, budget=Budget(1 << 20))
    assert (finding.severity, finding.rule) == ("unknown", "too-large")
