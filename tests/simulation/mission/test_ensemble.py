"""Sixteen members meet at barriers, with loss, drift and crashes: none hangs, all leave together."""

from random import Random
from typing import Any

import pytest
from tests.simulation.mission.ensemble import Ensemble, S, World, bind, blocks, swarm

from swarmware.mission.soundness import check
from swarmware.types.mission import Member

SIXTEEN = swarm(5, 10)


def course(member: Member, meetings: int = 4, timeout_s: float = 20.0) -> str:
    """Blocks and barriers in turn, as the formation mission has them; the ground station only meets."""
    ground_station = member.kind == "gcs"
    first = "m" if ground_station else "b"
    body: dict[str, Any] = {"s": {"type": "Start", "next": f"{first}1"}, "e": {"type": "End"}}
    for n in range(1, meetings + 1):
        after = f"{first}{n + 1}" if n < meetings else "e"
        late = "e" if ground_station else "l"
        meet = {"type": "Barrier", "id": f"m{n}", "timeout": timeout_s, "nextTimeout": late}
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


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_all_leave_every_barrier_together(seed: int, loss: float) -> None:
    ensemble = ordered(seed, World(loss=loss))
    ensemble.run(200)
    assert set(ensemble.outcomes().values()) == {"done"}
    spreads = ensemble.spreads_ns()
    assert len(spreads) == 5
    # conversions are wrong by up to 100 µs each way
    assert max(spreads.values()) <= 500_000, f"seed {seed}: {spreads}"


@pytest.mark.parametrize("seed", range(10))
def test_a_member_that_dies_sends_all_others_down(seed: int) -> None:
    ensemble = ordered(seed, World(loss=0.1))
    victim = ensemble.chance.choice(SIXTEEN[:-1]).platform
    ensemble.at(4 * S, lambda: ensemble.kill(victim))
    ensemble.run(200)
    assert len(ensemble.outcomes()) == 15
    assert set(ensemble.outcomes().values()) == {"done"}
    landed = [n.landed for n in ensemble.nodes.values() if n.alive and n.name != "gcs"]
    assert all(landed), f"seed {seed}, victim {victim}"


@pytest.mark.parametrize("seed", range(10))
def test_the_swarm_completes_its_course_without_the_ground_station(seed: int) -> None:
    ensemble = ordered(seed, World(loss=0.1))
    ensemble.at(round(ensemble.chance.uniform(3, 8) * S), lambda: ensemble.kill("gcs"))
    ensemble.run(200)
    assert len(ensemble.outcomes()) == 15
    passed = {(p.member, p.block): p.outcome for p in ensemble.passages if p.block != "@start"}
    for n in range(1, 5):
        assert {passed[name, f"m{n}"] for name in ensemble.outcomes()} == {"ok"}, f"seed {seed}"


@pytest.mark.parametrize("seed", range(10))
def test_nobody_starts_when_one_member_was_never_told(seed: int) -> None:
    ensemble = Ensemble(SIXTEEN, seed, World(loss=0.1))
    for member in SIXTEEN[:-1]:
        ensemble.at(S, lambda m=member: ensemble.order(m.platform, bind(course(m), m)))  # type: ignore[misc]  # as above
    ensemble.run(60)
    assert set(ensemble.outcomes().values()) == {"aborted", "idle"}
    assert not any(p.outcome == "ok" for p in ensemble.passages)


@pytest.mark.parametrize("seed", range(10))
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
                    work |= {"nextError": f"j{n}", "timeout": 2, "nextTimeout": f"j{n}"}
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
                body[f"d{n}"] = {"type": "Hold", "next": f"m{n}", "nextError": escape, "timeout": 3}
        meet: dict[str, Any] = {"type": "Barrier", "id": meeting, "next": after}
        if chance.random() < 0.7:
            meet |= {"timeout": chance.randrange(5, 20), "nextTimeout": escape}
        body[f"m{n}"] = meet
    body[f"x{len(meetings)}"] = {"type": "Wait", "ms": 10, "next": escape}
    return blocks(**body)


@pytest.mark.parametrize("seed", range(100))
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
