"""Hundreds of nodes in one cell, where all receive all: the air is never full and links stay up.

The cell has few whole brokers, and light nodes that load them like such. The figures are those that
table.py prints.
"""

from typing import Final

import pytest
from tests.simulation.directory.cell import Cell
from tests.simulation.seeds import cases

GOAL: Final = 0.25
"""Share of the air."""


@pytest.mark.slow
@pytest.mark.timeout(600)  # 15 s of an idle core
@pytest.mark.parametrize(
    ("count", "whole", "settle_s", "seconds"),
    cases([(200, 1, 40.0, 20.0)], [(200, 3, 40.0, 20.0), (500, 1, 150.0, 20.0)]),
)
def test_hundreds_in_one_cell_keep_their_links(
    count: int, whole: int, settle_s: float, seconds: float
) -> None:
    cell = Cell(1, count, whole)
    cell.run_for(settle_s)
    found = cell.measure(seconds)
    assert found.air_ratio <= GOAL
    assert found.links_ratio >= 0.995
    assert found.sent_hz <= 1.1 * cell.beacon_hz + 0.1, "nothing drives the rate up"
    assert found.changes_hz <= 0.05, "link changes per second and node"
    assert len(found.ages_s) >= 0.99 * whole * (count - 1) * seconds * 10, "a pose of each is known"
    found.ages_s.sort()
    median_s = found.ages_s[len(found.ages_s) // 2]
    assert median_s <= 0.75 / cell.beacon_hz + 0.05, "poses are as fresh as their rate allows"
