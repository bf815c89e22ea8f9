"""Ensembles whose members are pre-empted: the rest waits for them, and no barrier is split."""

from random import Random
from typing import Any

import pytest
from tests.simulation.mission.ensemble import Ensemble, S, World, bind, blocks, swarm
from tests.simulation.seeds import seeds

from swarmware.types.mission import Member

FIVE = swarm(2, 2)
VEHICLES = FIVE[:-1]


def patrol(member: Member, prefix: str, meetings: int) -> str:
    """Blocks and barriers in turn; the ground station only meets."""
    first = "m" if member.kind == "gcs" else "b"
    names = [f"{prefix}{first}{n}" for n in range(1, meetings + 1)] + ["e"]
    body: dict[str, Any] = {"s": {"type": "Start", "next": names[0]}, "e": {"type": "End"}}
    for n in range(1, meetings + 1):
        meet = f"{prefix}m{n}"
        body[meet] = {"type": "Barrier", "id": meet, "timeout_s": 120, "next": names[n]}
        if member.kind != "gcs":
            body[f"{prefix}b{n}"] = {"type": "Hold", "next": meet}
    return blocks(**body)


def play(seed: int, loss: float, rescues: int) -> Ensemble:
    """A patrol of all, and rescues of some at random moments, each in a random order of arrival."""
    ensemble = Ensemble(FIVE, seed, World(loss=loss))
    chance = Random(seed)
    plans = [(1, 0, FIVE, S, "p", 4)]
    for number in range(rescues):
        team = tuple(chance.sample(VEHICLES, chance.randint(1, 3)))
        at_ns = round(chance.uniform(1.5, 12) * S)
        plans.append((2 + number, chance.randint(0, 3), team, at_ns, f"r{number}", 1))
    for epoch, priority, team, at_ns, prefix, meetings in plans:
        for member in team:
            mission = bind(patrol(member, prefix, meetings), member)
            arrives_ns = at_ns + round(chance.uniform(0, 0.3) * S)
            ensemble.at(
                arrives_ns,
                lambda m=member, b=mission, e=epoch, p=priority, t=team: ensemble.order(  # type: ignore[misc]  # the defaults bind the values now
                    m.platform, b, e, p, t
                ),
            )
    ensemble.run(400)
    return ensemble


@pytest.mark.parametrize("seed", seeds(20, 300))
def test_pre_empted_members_come_back_and_all_end(seed: int) -> None:
    ensemble = play(seed, 0.0, rescues=3)
    assert set(ensemble.outcomes().values()) == {"done"}, f"seed {seed}"
    assert {passage.outcome for passage in ensemble.passages} <= {"ok", "suspended", "resumed"}, (
        f"seed {seed}"
    )
    assert all(node.core.is_idle for node in ensemble.nodes.values()), f"seed {seed}"


@pytest.mark.parametrize("seed", seeds(20, 300))
def test_pre_emption_with_loss_splits_no_barrier(seed: int) -> None:
    """A rescue that some members begin while others begin another one ends by the tolerance, for all."""
    ensemble = play(seed, 0.2, rescues=3)
    ends: dict[str, set[str]] = {}
    for passage in ensemble.passages:
        if passage.outcome not in {"suspended", "resumed", "cancelled"}:
            ends.setdefault(passage.block, set()).add(passage.outcome)
    assert [block for block, found in ends.items() if "ok" in found and len(found) > 1] == [], f"seed {seed}"
    assert all(node.core.is_idle for node in ensemble.nodes.values()), f"seed {seed}"
