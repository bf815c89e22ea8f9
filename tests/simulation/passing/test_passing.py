"""A ground vehicle of a formation passes whatever lies on its way, and has its slot again."""

import pytest
from tests.simulation.passing.passage import HAS_M, Passage, boulders, rubble
from tests.simulation.seeds import cases


@pytest.mark.parametrize(
    ("seed", "speed_m_s"), [(0, 1.0), (1, 2.0), (18, 2.5), (32, 2.5), (55, 2.5), (76, 2.5), (97, 2.5)]
)
def test_boulders_are_passed_without_large_delay(seed: int, speed_m_s: float) -> None:
    passage = Passage(boulders(seed), seed, speed_m_s)
    passage.drive(20)
    assert passage.gap_m > 0
    assert passage.behind_m < HAS_M
    assert passage.worst_m < 8


@pytest.mark.slow
@pytest.mark.parametrize("seed", cases(range(8, 60), range(60, 200)))
def test_so_are_many_others(seed: int) -> None:
    passage = Passage(boulders(seed), seed)
    passage.drive(20)
    assert passage.gap_m > 0
    assert passage.behind_m < HAS_M


@pytest.mark.parametrize("seed", range(5))
def test_close_obstacles_are_avoided_and_end_no_drive(seed: int) -> None:
    passage = Passage(rubble(seed), seed)
    passage.drive(60)
    assert passage.gap_m > 0
    assert passage.behind_m < HAS_M
