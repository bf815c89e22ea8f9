"""Sixteen members meet at barriers, with loss, drift and crashes: none hangs, all leave together."""

from random import Random
from typing import Any

import pytest
from tests.simulation.mission.ensemble import Ensemble, S, World, bind, blocks, swarm
from tests.simulation.seeds import seeds

from swarmware.mission.check import check_folder
from swarmware.mission.finding import Finding
from swarmware.mission.folder import from_files
from swarmware.mission.soundness import check
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import Member, MissionFile

SIXTEEN = swarm(5, 10)


def course(member: Member, meetings: int = 4, timeout_s: float = 20.0) -> str:
    """Blocks and barriers in turn, as the formation mission has them; the ground station only meets."""
    ground_station = member.kind == "gcs"
    first = "m" if ground_station else "b"
    body: dict[str, Any] = {"s": {"type": "Start", "next": f"{first}1"}, "e": {"type": "End"}}
    for n in range(1, meetings + 1):
        after = f"{first}{n + 1}" if n < meetings else "e"
        late = "e" if ground_station else "l"
        meet = {"type": "Barrier", "id": f"m{n}", "timeout_s": timeout_s, "nextTimeout": late}
        body[f"m{n}"] = {**meet, "next": after}
        if not ground_station:
            body[f"b{n}"] = {"type": "Arm", "next": f"m{n}", "nextError": "l", "nextTimeout": "l"}
    if member.kind != "gcs":
        body["l"] = {"type": "Land", "next": "e"}
    return blocks(**body)


def ordered(seed: int, world: World, **options: Any) -> Ensemble:
    ensemble = Ensemble(SIXTEEN, seed, world)
    for number, member in enumerate(SIXTEEN):
        mission = bind(course(member, **options), member)
        ensemble.at(S + number * 1_000_000, lambda m=member, b=mission: ensemble.order(m.platform, b))  # type: ignore[misc]  # the default binds the value now
    return ensemble


@pytest.mark.parametrize("seed", seeds(2, 10))
@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_all_leave_every_barrier_together(seed: int, loss: float) -> None:
    ensemble = ordered(seed, World(loss=loss))
    ensemble.run(200)
    assert set(ensemble.outcomes().values()) == {"done"}
    spreads = ensemble.spreads_ns()
    assert len(spreads) == 5
    # conversions are wrong by up to 100 µs each way
    assert max(spreads.values()) <= 500_000, f"seed {seed}: {spreads}"


@pytest.mark.parametrize("seed", seeds(2, 10))
@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_all_leave_together_while_the_links_are_slow(seed: int, loss: float) -> None:
    """Computers short of processor time send a beacon a second: the news of a barrier takes that long."""
    ensemble = ordered(seed, World(loss=loss, beacon_hz=1.0, delay_ms=(940.0, 1000.0)))
    ensemble.run(200)
    assert set(ensemble.outcomes().values()) == {"done"}
    spreads = ensemble.spreads_ns()
    assert len(spreads) == 5
    assert max(spreads.values()) <= 500_000, f"seed {seed}: {spreads}"


@pytest.mark.parametrize("seed", seeds(2, 10))
def test_a_member_that_dies_sends_all_others_down(seed: int) -> None:
    ensemble = ordered(seed, World(loss=0.1))
    victim = ensemble.chance.choice(SIXTEEN[:-1]).platform
    ensemble.at(4 * S, lambda: ensemble.kill(victim))
    ensemble.run(200)
    assert len(ensemble.outcomes()) == 15
    assert set(ensemble.outcomes().values()) == {"done"}
    landed = [n.landed for n in ensemble.nodes.values() if n.alive and n.name != "gcs"]
    assert all(landed), f"seed {seed}, victim {victim}"


@pytest.mark.parametrize("seed", seeds(2, 10))
def test_swarm_completes_its_course_without_ground_station(seed: int) -> None:
    ensemble = ordered(seed, World(loss=0.1))
    ensemble.at(round(ensemble.chance.uniform(3, 8) * S), lambda: ensemble.kill("gcs"))
    ensemble.run(200)
    assert len(ensemble.outcomes()) == 15
    passed = {(p.member, p.block): p.outcome for p in ensemble.passages if p.block != "@start"}
    for n in range(1, 5):
        assert {passed[name, f"m{n}"] for name in ensemble.outcomes()} == {"ok"}, f"seed {seed}"


@pytest.mark.parametrize("seed", seeds(2, 10))
def test_nobody_starts_when_one_member_was_never_told(seed: int) -> None:
    ensemble = Ensemble(SIXTEEN, seed, World(loss=0.1))
    for member in SIXTEEN[:-1]:
        ensemble.at(S, lambda m=member: ensemble.order(m.platform, bind(course(m), m)))  # type: ignore[misc]  # as above
    ensemble.run(60)
    assert set(ensemble.outcomes().values()) == {"idle"}
    assert not any(p.outcome == "ok" for p in ensemble.passages)


@pytest.mark.parametrize("seed", seeds(2, 10))
def test_an_abort_at_one_brings_everybody_down(seed: int) -> None:
    ensemble = ordered(seed, World(loss=0.1))
    ensemble.at(5 * S, lambda: ensemble.abort("uav3"))
    ensemble.run(200)
    assert ensemble.outcomes().pop("uav3") == "aborted"
    assert all(n.landed for n in ensemble.nodes.values() if n.name != "gcs")


def random_mission(chance: Random, member: Member, meetings: list[str]) -> str:
    """A sound mission with forks, decisions and time-outs that comes to all these barriers in order."""
    body: dict[str, Any] = {"s": {"type": "Start", "next": "x0"}, "e": {"type": "End"}}
    ground_station = member.kind == "gcs"
    escape = "e" if ground_station else "l"
    if not ground_station:
        body["l"] = {"type": "Land", "next": "e"}
    for n, meeting in enumerate(meetings):
        after = f"x{n + 1}"
        match chance.randrange(3 if not ground_station else 1):
            case 0:
                body[f"x{n}"] = {"type": "Wait", "ms": chance.randrange(10, 3000), "next": f"m{n}"}
            case 1:
                work: dict[str, Any] = {"type": "Arm", "next": f"j{n}"}
                if chance.random() < 0.7:
                    work |= {"nextError": f"j{n}", "timeout_s": 2, "nextTimeout": f"j{n}"}
                body[f"x{n}"] = {"type": "Fork", "next": [f"a{n}", f"w{n}"]}
                body[f"a{n}"] = work
                body[f"w{n}"] = {"type": "Wait", "ms": chance.randrange(10, 2000), "next": f"j{n}"}
                body[f"j{n}"] = {"type": "Join", "next": f"m{n}"}
            case _:
                body[f"x{n}"] = {
                    "type": "DecisionRandom",
                    "chanceForTrue": chance.random(),
                    "nextIfTrue": f"d{n}",
                    "nextIfFalse": f"m{n}",
                }
                body[f"d{n}"] = {"type": "Hold", "next": f"m{n}", "nextError": escape, "timeout_s": 3}
        meet: dict[str, Any] = {"type": "Barrier", "id": meeting, "next": after}
        if chance.random() < 0.7:
            meet |= {"timeout_s": chance.randrange(5, 20), "nextTimeout": escape}
        body[f"m{n}"] = meet
    body[f"x{len(meetings)}"] = {"type": "Wait", "ms": 10, "next": escape}
    return blocks(**body)


@pytest.mark.parametrize("seed", seeds(12, 100))
def test_random_missions_with_random_faults_never_hang(seed: int) -> None:
    chance = Random(f"mission {seed}")
    members = swarm(chance.randint(1, 3), chance.randint(1, 5))
    world = World(
        loss=chance.choice([0.0, 0.1, 0.3]),
        fail=chance.choice([0.0, 0.05, 0.2]),
        hang=chance.choice([0.0, 0.05, 0.2]),
    )
    ensemble = Ensemble(members, seed, world)
    meetings = [f"m{n}" for n in range(chance.randint(1, 5))]
    for member in members:
        mission = bind(random_mission(chance, member, meetings), member)
        assert [r for r in check(mission) if r.severity == "error"] == []
        at_ns = S + round(chance.uniform(0, 2) * S)
        ensemble.at(at_ns, lambda m=member, b=mission: ensemble.order(m.platform, b))  # type: ignore[misc]  # as above
    if chance.random() < 0.3:
        victim = chance.choice(members).platform
        ensemble.at(round(chance.uniform(1, 12) * S), lambda: ensemble.kill(victim))
    if chance.random() < 0.2:
        stopped = chance.choice(members).platform
        ensemble.at(round(chance.uniform(5, 15) * S), lambda: ensemble.abort(stopped))
    ensemble.run(900)
    outcomes = ensemble.outcomes()
    assert set(outcomes.values()) <= {"done", "failed", "aborted"}, f"seed {seed}: {outcomes}"
    for node in ensemble.nodes.values():
        started = any(p.member == node.name and p.block == "@start" for p in ensemble.passages)
        if node.alive and started and node.name != "gcs":
            assert node.landed, f"seed {seed}: {node.name} {outcomes[node.name]}: {node.core.state().text}"


@pytest.mark.parametrize("seed", seeds(3, 13))
def test_barrier_releases_all_within_half_second(seed: int) -> None:
    chance = Random(f"cut {seed}")
    ensemble = ordered(seed, World(loss=0.1), meetings=2)
    lonely = chance.choice(SIXTEEN).platform
    at_ns, back_ns = round(chance.uniform(2, 6) * S), round(chance.uniform(1, 4) * S)
    ensemble.at(at_ns, lambda: ensemble.cut_off.add(lonely))
    ensemble.at(at_ns + back_ns, lambda: ensemble.cut_off.discard(lonely))
    ensemble.run(200)
    assert set(ensemble.outcomes().values()) <= {"done", "aborted"}
    # half a second, the step of the members' clocks and conversions, and the news of a changed common time
    assert max(ensemble.spreads_ns().values()) <= 0.6 * S, f"seed {seed}: {ensemble.spreads_ns()}"


def wild_mission(chance: Random, member: Member, ids: list[str]) -> str:
    """Barriers of these ids in any order, several times, some with a time-out, with ways around them."""
    body: dict[str, Any] = {"s": {"type": "Start", "next": "x0"}, "e": {"type": "End"}}
    order = ids if chance.random() < 0.6 else chance.sample(ids, len(ids))
    order = [i for i in order for _ in range(chance.choice([1, 1, 1, 2]))]
    for n, name in enumerate(order):
        after = f"x{n + 1}"
        meet: dict[str, Any] = {"type": "Barrier", "id": name, "next": after}
        if chance.random() < 0.3:
            ahead = chance.choice([f"x{k}" for k in range(n + 1, len(order) + 1)] + ["e"])
            meet |= {"timeout_s": chance.randrange(3, 9), "nextTimeout": ahead}
        body[f"m{n}"] = meet
        match chance.randrange(6):
            case 0:
                body[f"x{n}"] = {
                    "type": "DecisionRandom",
                    "chanceForTrue": 0.5,
                    "nextIfTrue": f"m{n}",
                    "nextIfFalse": chance.choice([after, f"m{n}"]),
                }
            case _:
                body[f"x{n}"] = {"type": "Wait", "ms": chance.randrange(10, 1500), "next": f"m{n}"}
    body[f"x{len(order)}"] = {"type": "Wait", "ms": 10, "next": "e"}
    return blocks(**body)


def wild(seed: int) -> tuple[list[str], list[tuple[str, str, int]]]:
    """Texts of the roles, and their names, kinds and numbers of members."""
    chance = Random(f"wild {seed}")
    ids = [f"m{n}" for n in range(chance.randint(1, 3))]
    roles = [("ground", "ugv", chance.randint(1, 2)), ("air", "uav", chance.randint(1, 2))]
    roles = roles[: chance.randint(1, 2)]
    texts = [wild_mission(chance, Member("x", name, PlatformKind(kind)), ids) for name, kind, _ in roles]
    return texts, roles


def verdict(texts: list[str], roles: list[tuple[str, str, int]]) -> list[Finding]:
    manifest = 'name = "wild"\n' + "".join(
        f'[[roles]]\nname = "{name}"\nfile = "{name}.json"\nkinds = ["{kind}"]\ntake = {take}\n'
        for name, kind, take in roles
    )
    files = [MissionFile(f"{role[0]}.json", text) for role, text in zip(roles, texts, strict=True)]
    found = check_folder(from_files([MissionFile("mission.toml", manifest), *files], ""))
    return [finding for finding in found if finding.severity != "warning"]


def played(texts: list[str], roles: list[tuple[str, str, int]], seed: int) -> Ensemble:
    members = tuple(
        Member(f"{kind}{n}", name, PlatformKind(kind))
        for name, kind, take in roles
        for n in range(1, take + 1)
    )
    ensemble = Ensemble(members, seed, World(loss=0.1))
    by_role = {role[0]: text for role, text in zip(roles, texts, strict=True)}
    for member in members:
        mission = bind(by_role[member.role], member)
        ensemble.at(S, lambda m=member, b=mission: ensemble.order(m.platform, b))  # type: ignore[misc]  # as above
    ensemble.run(120)
    return ensemble


def test_ensembles_hang_or_fail_only_when_check_warns() -> None:
    sound = refused = hung = failed = 0
    for seed in seeds(90, 150):
        texts, roles = wild(seed)
        found = verdict(texts, roles)
        fails = any(f.rule == "unequal-visits" for f in found)
        assert fails or all("for ever" in f.message or "never comes" in f.message for f in found), found
        for throw in range(2):
            ensemble = played(texts, roles, throw)
            over = set(ensemble.outcomes().values()) <= {"done", "failed", "aborted"}
            assert over or found, f"seed {seed}: {ensemble.outcomes()} hangs, and the check found nothing"
            assert not fails or "failed" in ensemble.outcomes().values(), f"seed {seed}: {found}"
            hung += not over
        sound += not found
        refused += any("for ever" in f.message for f in found)
        failed += fails
    # all three kinds are among them, or the test would say nothing
    assert min(sound, refused, hung) > 10, (sound, refused, hung)
    assert failed > 2


@pytest.mark.parametrize("seed", seeds(2, 5))
def test_second_block_of_id_is_separate_meeting(seed: int) -> None:
    members = swarm(1, 2)
    ensemble = Ensemble(members, seed, World(loss=0.1))
    for slow, member in enumerate(members):
        text = blocks(
            s={"type": "Start", "next": "one"},
            one={"type": "Barrier", "id": "m", "next": "w"},
            w={"type": "Wait", "s": 4 * slow, "next": "two"},
            two={"type": "Barrier", "id": "m", "next": "e"},
            e={"type": "End"},
        )
        mission = bind(text, member)
        ensemble.at(S, lambda m=member, b=mission: ensemble.order(m.platform, b))  # type: ignore[misc]  # as above
    ensemble.run(60)
    assert set(ensemble.outcomes().values()) == {"done"}
    assert max(ensemble.spreads_ns().values()) <= 500_000
    first, second = (max(p.at_ns for p in ensemble.passages if p.block == block) for block in ("one", "two"))
    assert second - first >= 4 * (len(members) - 1) * S
