"""Reduced nets: the same is found in them as in the whole ones, and wide harmless missions are checked."""

import time
from collections import Counter
from collections.abc import Callable
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.simulation.seeds import examples
from tests.unit.mission.nets import choice, lattice, net, tangle, wide

from swarmware.mission import instants, meetings, soundness
from swarmware.mission.binding import Binding
from swarmware.mission.budget import QUICK_BYTES, Budget
from swarmware.mission.check import check_folder, check_text
from swarmware.mission.finding import Remark
from swarmware.mission.folder import Folder, from_files
from swarmware.mission.loader import load, read
from swarmware.mission.model import MissionDefinition
from swarmware.mission.net import Net, build
from swarmware.mission.participant import Participant
from swarmware.types.mission import MissionFile

HERE = Binding()
SMALL = 4 << 20
"""Enough for all states of the small nets of these tests."""


def verdict(remarks: list[Remark]) -> set[tuple[str, str]]:
    return {(remark.severity, remark.rule) for remark in remarks}


def both(text: str) -> tuple[set[tuple[str, str]], set[tuple[str, str]]] | None:
    """Findings in the whole net and in the reduced one, or None if there is nothing to compare."""
    mission = read(text, "m.json", HERE).mission
    assert mission is not None
    if instants.check(mission):
        return None  # refused by that; the states of a loop that never rests mean nothing
    whole, budget = build(mission), Budget(SMALL)
    wanted = verdict(soundness.explore(mission, whole, budget, flies=True))
    if budget.spent:
        return None
    small = soundness.reduced(mission, whole, Budget())
    assert len(small.owner) <= len(whole.owner)
    return wanted, verdict(soundness.explore(mission, small, Budget(), flies=True))


TWO_TOKENS = ("error", "two-tokens")


@settings(max_examples=examples(100, 300))
@given(st.integers(0, 2**32))
def test_reduced_net_gives_same_findings(seed: int) -> None:
    compared = both(tangle(Random(seed)))
    if compared is None:
        return
    wanted, found = compared
    if TWO_TOKENS in wanted:
        assert TWO_TOKENS in found  # behind a second token nothing is looked at, in neither
    else:
        assert found == wanted


def test_compared_nets_have_all_that_can_be_found() -> None:
    seen: Counter[str] = Counter()
    for seed in range(400):
        compared = both(tangle(Random(seed)))
        seen.update(rule for _, rule in compared[0] or {("", "sound")}) if compared else None
    rules = "sound deadlock dead-block never-ends two-tokens two-motions not-in-the-air cut-short"
    assert set(rules.split()) | {"ends-in-the-air"} <= set(seen)


@pytest.mark.parametrize(
    ("text", "rules"),
    [
        # the End comes at once: nobody is ever in b twice
        (net(s="Start>f", f="Fork>a,b,e", a="Wait>b", b="Wait>e", e="End"), {"cut-short"}),
        # the End of one branch cuts short the motion of the other
        (
            net(
                s="Start>f",
                f="Fork>a,m",
                a={"type": "Arm", "next": "j", "nextTimeout": "e2"},
                m="Hold>j",
                j="Join>e",
                e="End",
                e2={"type": "End", "result": "failed"},
            ),
            {"cut-short"},
        ),
    ],
    ids=["an End at once", "an End of one branch"],
)
def test_states_that_end_distinguishes_stay_separate(text: str, rules: set[str]) -> None:
    compared = both(text)
    assert compared is not None
    assert [{rule for _, rule in found} for found in compared] == [rules, rules]


def polls(n: int) -> dict[str, Any]:
    """Reads a value until it is as expected."""
    cases = [{"if": "battery < 30 %", "next": "j"}]
    return {f"d{n}": {"type": "Decision", "cases": cases, "next": f"w{n}"}, f"w{n}": f"Wait>d{n}"}


def gives_up(n: int) -> dict[str, Any]:
    """May end the mission."""
    first = {"type": "Arm", "next": f"v{n}", "nextTimeout": "e", "nextError": f"x{n}"}
    second = {"type": "Arm", "next": "j", "nextTimeout": "e", "nextError": f"x{n}"}
    return {f"w{n}": first, f"v{n}": second, f"x{n}": {"type": "End", "result": "failed"}}


def tries_again(n: int) -> dict[str, Any]:
    """Comes to the same by many ways."""
    arm = {"type": "Arm", "next": f"v{n}", "nextTimeout": f"r{n}", "nextError": f"w{n}"}
    return {f"w{n}": arm, f"r{n}": f"Wait>d{n}", f"d{n}": choice(f"w{n}", f"v{n}"), f"v{n}": "Wait>j"}


def line(n: int) -> dict[str, Any]:
    return {f"w{n}_{k}": f"Wait>w{n}_{k + 1}" if k < 39 else "Wait>j" for k in range(40)}


def nested(depth: int) -> str:
    blocks: dict[str, Any] = {f"a{depth}": f"Wait>j{depth - 1}"}
    for k in range(depth):
        blocks[f"f{k}"] = f"Fork>a{k}," + (f"f{k + 1}" if k < depth - 1 else f"a{depth}")
        blocks[f"a{k}"] = f"Wait>j{k}"
        blocks[f"j{k}"] = f"Join>j{k - 1}" if k else "Join>e"
    return net(s="Start>f0", **blocks, e="End")


def beside_a_flight(branches: int) -> str:
    pauses = {f"w{n}": f"Wait>v{n}" for n in range(branches)} | {f"v{n}": "Wait>j" for n in range(branches)}
    return net(
        s="Start>arm",
        arm="Arm>t",
        t={"type": "Takeoff", "alt": 5, "next": "f"},
        f="Fork>g," + ",".join(f"w{n}" for n in range(branches)),
        **pauses,
        g={"type": "Goto", "x": 1, "y": 1, "next": "h"},
        h="Hold>j",
        j="Join>l",
        l="Land>e",
        e="End",
    )


LARGE: dict[str, Callable[[], str]] = {
    "200 pauses": lambda: wide(200, lambda n: {f"w{n}": "Wait>j"}),
    "200 barriers": lambda: wide(200, lambda n: {f"w{n}": {"type": "Barrier", "id": f"b{n}", "next": "j"}}),
    "60 branches that wait for a value": lambda: wide(60, polls),
    "60 branches that may give up": lambda: wide(60, gives_up),
    "60 branches that try again": lambda: wide(60, tries_again),
    "3 lines of 40": lambda: wide(3, line),
    "40 nested forks": lambda: nested(40),
    "1 000 blocks in a line": lambda: net(
        s="Start>w0", **{f"w{n}": f"Wait>w{n + 1}" for n in range(999)}, w999="Wait>e", e="End"
    ),
    "100 branches beside a flight": lambda: beside_a_flight(100),
}


@pytest.mark.parametrize("name", LARGE)
def test_wide_harmless_mission_is_sound_within_quick_budget(name: str) -> None:
    mission = load(LARGE[name](), "m.json", HERE)
    # twice the 10 ms that the event loop grants
    budget = Budget(2 * QUICK_BYTES)
    assert soundness.check(mission, budget, flies=True) == []
    assert not budget.spent


WRONG: dict[str, tuple[Callable[[], str], str]] = {
    "one branch never arrives": (
        lambda: wide(
            200, lambda n: {f"w{n}": choice(f"x{n}", "e") if n == 100 else "Wait>j", f"x{n}": "Wait>k"}
        ).replace('"e": {"type": "End"}', '"e": {"type": "End"}, "k": {"type": "Join", "next": "j"}'),
        "deadlock",
    ),
    "one branch goes round for ever": (
        lambda: wide(
            200, lambda n: {"w": choice("j", "v"), "v": "Wait>v"} if n == 100 else {f"w{n}": "Wait>j"}
        ),
        "never-ends",
    ),
    "two branches meet without a Join": (
        lambda: wide(
            200,
            lambda n: {
                f"w{n}": "Wait>k" if n in {10, 90} else "Wait>j",
                **({"k": "Wait>j"} if n == 10 else {}),
            },
        ),
        "two-tokens",
    ),
    "a block nobody comes to": (
        lambda: wide(200, lambda n: {f"w{n}": "Wait>j", **({"k": "Wait>e"} if n == 7 else {})}),
        "dead-block",
    ),
    "two motions": (
        lambda: wide(200, lambda n: {f"w{n}": {"type": "Hold", "next": "j"} if n in {3, 150} else "Wait>j"}),
        "two-motions",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_one_wrong_branch_among_two_hundred_is_found(name: str) -> None:
    make, rule = WRONG[name]
    found = soundness.check(load(make(), "m.json", HERE), Budget(8 << 20))
    assert rule in {remark.rule for remark in found if remark.severity == "error"}
    assert "too-large" not in {remark.rule for remark in found}


def test_error_in_large_mission_has_way_there() -> None:
    text = wide(30, lambda n: {f"w{n}": f"Wait>v{n}", f"v{n}": "Wait>v0" if n == 9 else "Wait>j"})
    remark = next(r for r in soundness.check(load(text, "m.json", HERE)) if r.rule == "two-tokens")
    assert remark.block in {"v0", "j"}  # two tokens there, or two on the way from there to the Join
    assert {"s", "f", "w0", "w9", "v9"} <= set(remark.trace)


def test_oversized_mission_is_neither_sound_nor_invalid() -> None:
    findings = check_text(lattice(12, 3), "m.json", HERE, budget=Budget(1 << 20))[1]
    assert [(f.severity, f.rule) for f in findings] == [("unknown", "too-large")]
    assert "13 blocks can run at the same time (" in findings[0].message
    assert check_text(lattice(4, 2), "m.json", HERE)[1] == []


# -- where members meet


def author(chance: Random) -> dict[str, Any]:
    """Branches, choices and loops with barriers in them."""
    blocks: dict[str, Any] = {"e": "End", "x": {"type": "End", "result": "failed"}}

    def part(depth: int, after: str) -> str:
        name = f"b{len(blocks)}"
        kind = chance.choice([0, 1, 2, 2, 3, 4, 5, 6, 7, 7] if depth else [0, 1, 2])
        blocks[name] = f"Wait>{after}"
        if kind == 1:
            blocks[name] = {"type": "Arm", "next": after}
            if chance.random() < 0.6:
                other = chance.choice([after, "x"])
                blocks[name] |= {"nextError": other, "nextTimeout": other}
        elif kind == 2:
            blocks[name] = {"type": "Barrier", "id": chance.choice("pqr"), "next": after}
            if chance.random() < 0.4:
                blocks[name] |= {"timeout_s": 5, "nextTimeout": chance.choice([after, "x"])}
        elif kind in {3, 4}:
            blocks[name] = f"Join>{after}"
            heads = [part(depth - 1, name) for _ in range(2)]
            blocks[f"f{name}"] = "Fork>" + ",".join(heads)
            return f"f{name}"
        elif kind == 5:
            blocks[name] = choice(part(depth - 1, after), part(depth - 1, after))
        elif kind == 6:
            blocks[f"w{name}"] = f"Wait>{name}"
            blocks[name] = choice(part(depth - 1, f"w{name}"), after)
        elif kind == 7:
            blocks[name] = f"Join>{after}"
            alike = [
                like(f"{name}_{n}", name, kind=chance.randint(0, 3)) for n in range(chance.randint(2, 3))
            ]
            if chance.random() < 0.7:
                way = chance.randint(0, 3)
                alike = [like(f"{name}_{n}", name, kind=way) for n in range(3)]
            for branch in alike:
                blocks.update(branch)
            blocks[f"f{name}"] = "Fork>" + ",".join(next(iter(branch)) for branch in alike)
            return f"f{name}"
        return name

    def like(head: str, after: str, kind: int) -> dict[str, Any]:
        gate: dict[str, Any] = {"type": "Barrier", "id": head, "next": after}
        if kind == 1:
            return {f"{head}v": f"Wait>{head}", head: gate}
        if kind == 2:
            return {head: gate | {"timeout_s": 5, "nextTimeout": chance.choice([after, "x"])}}
        if kind == 3:
            return {f"{head}v": {"type": "Arm", "next": head}, head: gate}
        return {head: gate}

    first = part(chance.randint(1, 3), "e")
    return {"s": f"Start>{first}", **blocks}


def authors(chance: Random) -> list[MissionDefinition]:
    """Missions of one or two roles; a second one may be the same, or lack one barrier."""
    texts = [author(chance) for _ in range(chance.randint(1, 2))]
    if chance.random() < 0.5:
        barriers = [name for name, block in texts[0].items() if "Barrier" in str(block)]
        texts = [texts[0], dict(texts[0])]
        if barriers and chance.random() < 0.6:
            name = chance.choice(barriers)
            texts[1][name] = f"Wait>{texts[1][name]['next']}"
    return [load(net(**text), "m.json", HERE) for text in texts]


def whole_net(net: Net, *_: object) -> Net:
    return net


def all_branches(nets: list[Net], *_: object) -> list[Net]:
    return nets


def kind_of(found: object) -> tuple[str, bool]:
    return type(found).__name__, isinstance(found, meetings.Failure) and found.certain


def test_reduced_nets_hang_and_fail_like_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: Counter[tuple[str, bool]] = Counter()
    for seed in range(examples(400, 3_000)):
        chance = Random(seed)
        missions = authors(chance)
        if any(remark.severity != "warning" for m in missions for remark in soundness.check(m)):
            continue
        parts = [Participant(f"r{n}", m, chance.randint(1, 2)) for n, m in enumerate(missions)]
        budget = Budget(4 << 20)
        with monkeypatch.context() as patched:
            patched.setattr(meetings, "reduce", whole_net)
            patched.setattr(meetings, "merge", all_branches)
            wanted = meetings.search(parts, budget)
        if not budget.spent:
            found = meetings.search(parts, Budget())
            assert kind_of(found) == kind_of(wanted), seed
            seen[kind_of(found)] += 1
    assert seen["NoneType", False] > 20
    missing = {("Deadlock", False), ("Failure", False), ("Failure", True)} - set(seen)
    assert not missing


def test_two_hundred_pauses_beside_barrier_are_checked() -> None:
    meet = {"type": "Barrier", "id": "all", "next": "j", "nextTimeout": "j", "timeout_s": 9}
    text = wide(200, lambda n: {f"w{n}": meet if n == 0 else "Wait>j"})
    manifest = 'name = "trial"\n[[roles]]\nname = "a"\nfile = "m.json"\nkinds = ["uav", "ugv"]\n'
    folder = from_files([MissionFile("mission.toml", manifest), MissionFile("m.json", text)], "")
    assert check_folder(folder, budget=Budget(8 << 20)) == []


def in_the_air(branches: int, body: Callable[[int], dict[str, Any]]) -> Folder:
    manifest = 'name = "trial"\n[[roles]]\nname = "air"\nfile = "m.json"\nkinds = ["uav"]\n'
    files = [MissionFile("mission.toml", manifest), MissionFile("m.json", wide(branches, body))]
    return from_files(files, "")


def plain(n: int) -> dict[str, Any]:
    return {f"w{n}": {"type": "Barrier", "id": f"b{n}", "next": "j"}}


def after_a_pause(n: int) -> dict[str, Any]:
    return {f"v{n}": f"Wait>w{n}", **plain(n)} if n % 2 else plain(n)


def after_arming(n: int) -> dict[str, Any]:
    return {f"v{n}": {"type": "Arm", "next": f"w{n}"}, **plain(n)}


def twice(n: int) -> dict[str, Any]:
    return {f"v{n}": {"type": "Barrier", "id": f"a{n}", "next": f"w{n}"}, **plain(n)}


def timed(n: int) -> dict[str, Any]:
    return {f"w{n}": plain(n)[f"w{n}"] | {"timeout_s": 5, "nextTimeout": "e"}}


def own_ways(n: int) -> dict[str, Any]:
    """Goes another way when the barrier breaks: no branch stands for another."""
    way = {"timeout_s": 5, "next": f"m{n}", "nextTimeout": f"h{n}"}
    arm = {"type": "Arm", "next": f"m{n}", "nextError": f"m{n}"}
    return {f"w{n}": plain(n)[f"w{n}"] | way, f"h{n}": arm, f"m{n}": "Wait>j"}


@pytest.mark.parametrize("branches", [12, 200])
@pytest.mark.parametrize("body", [plain, after_a_pause, after_arming, twice, timed])
def test_alike_parallel_barriers_are_sound_within_budget(
    body: Callable[[int], dict[str, Any]], branches: int
) -> None:
    found = check_folder(in_the_air(branches, body))
    assert {(finding.severity, finding.rule) for finding in found} <= {("warning", "broken-barrier")}


@pytest.mark.parametrize("branches", [12, 200])
@pytest.mark.parametrize("of_one_role", [own_ways, None], ids=["meetings", "one mission"])
def test_oversized_check_ends_soon_and_names_blocks(
    of_one_role: Callable[[int], dict[str, Any]] | None, branches: int
) -> None:
    """The time is bounded by the states: about one second of a processor."""
    folder = in_the_air(branches, of_one_role) if of_one_role else alone(lattice(branches, 3))
    before_s = time.process_time()
    (finding,) = check_folder(folder)
    assert time.process_time() - before_s < 4.0
    assert (finding.severity, finding.rule) == ("unknown", "too-large")
    assert "(w0, w1, w2, w3, …)" in finding.message or "blocks can run at the same time (" in finding.message


def alone(text: str) -> Folder:
    return from_files([MissionFile("m.json", text)], "")


def test_ensemble_with_many_parallel_barriers_names_them() -> None:
    (finding,) = check_folder(in_the_air(14, own_ways), budget=Budget(4 << 20))
    assert (finding.severity, finding.rule, finding.pointer) == ("unknown", "too-large", "/mission/w0")
    assert "role 'air' can wait at 14 barriers at the same time (w0, w1, w2, w3, …)" in finding.message
