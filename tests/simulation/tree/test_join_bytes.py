"""What it costs to join a swarm, to come back to it, and to be in it: bytes of frames with their headers.

The trees, templates and settings that are shipped; neighbours of one cell, in virtual time.
"""

from typing import Any

import pytest
from tests.simulation.tree.cell import Cell

from swarmware.types.tree_exchange import TreeItem

S = 1_000_000_000
SESSION_BYTES = 500
"""Limit of questions and answers of sessions (directory/test_join_sessions.py)."""


def cell(patterns: dict[str, tuple[str, ...]], **weather: Any) -> Cell:
    """Sixteen nodes that came one after the other, and know each other."""
    found = Cell(patterns, **weather)
    for name in found.trees:
        found.join(name)
        found.run_for(SETTLED_S if found.loss else 1.0)
    found.run_for(SETTLED_S)
    assert found.complete()
    return found


SETTLED_S = 10.0
"""What was lost is requested after 2 s, and again after a second."""
WANTS = {"uav9": ("/*/app/*", "/*/nav/pose"), "gcs": ("/*/app/*",)}


@pytest.mark.parametrize("patterns", [{}, WANTS])
def test_second_visit_to_sixteen_nodes_costs_hundred_bytes(
    patterns: dict[str, tuple[str, ...]],
) -> None:
    swarm = cell(patterns)
    swarm.leave("uav9")
    swarm.run_for(20)
    before = swarm.bytes["uav9"]
    swarm.join("uav9")
    swarm.run_for(5)
    assert swarm.complete()
    assert swarm.bytes["uav9"] - before <= 100
    swarm.feed("ugv1", swarm.trees["ugv1"].on_values([TreeItem("app/ugv1", 7, 1, 1, 1, b"x")], swarm.now_ns))
    swarm.run_for(1)
    assert (swarm.bytes["uav9"] - before > 100) is bool(patterns), "its subscription holds"


@pytest.mark.parametrize("patterns", [{}, WANTS])
def test_at_rest_nothing_is_sent_however_long(patterns: dict[str, tuple[str, ...]]) -> None:
    swarm = cell(patterns)
    before = dict(swarm.bytes)
    swarm.run_for(3600)
    assert swarm.bytes == before


def joined(swarm: Cell) -> tuple[int, int]:
    """Bytes of structures that the last one of sixteen sent and received, and all other bytes."""
    structure = swarm.structure_bytes["uav15"]
    return structure, swarm.bytes["uav15"] - structure


def test_joining_sixteen_nodes_costs_kilobyte_and_structures() -> None:
    swarm = cell({})
    structure, rest = joined(swarm)
    # each structure twice at most: for whoever came late, it is repeated
    assert structure <= 850
    assert rest + SESSION_BYTES <= 1_000
    assert not swarm.frames["uav15"], "beacons bring everything; no frame is needed"


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(("loss", "limit"), [(0.0, 500), (0.1, 800), (0.3, 2_600)])
def test_join_completes_despite_loss_and_beats_single_requests(seed: int, loss: float, limit: int) -> None:
    swarm = cell({}, seed=seed, loss=loss)
    assert joined(swarm)[1] <= limit


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_restarted_tree_knows_all_structures_and_is_known(loss: float) -> None:
    swarm = cell({}, seed=5, loss=loss)
    before = swarm.bytes["uav9"]
    swarm.restart("uav9", "multirotor", 77)
    swarm.run_for(SETTLED_S)
    assert swarm.complete()
    epochs = {swarm.trees[name].replicas.get("uav9").epoch for name in swarm.up - {"uav9"}}  # type: ignore[union-attr]
    assert epochs == {77}
    assert loss or swarm.bytes["uav9"] - before <= 2_850


@pytest.mark.parametrize("former", [("uav9",), ("gcs", "ugv1", "uav15"), ("uav15",)])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_nodes_of_former_version_join_and_are_known(former: tuple[str, ...], loss: float) -> None:
    swarm = cell({}, seed=3, loss=loss, former=former)
    for name in former:
        assert swarm.frames[name] >= 15 * 4, "it asks each, and each asks it"
