"""A cut link is noticed, gone around and used again in time."""

import pytest
from tests.simulation.directory.link_loss import outages, worst

SEEDS = range(1, 11)


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_a_cut_link_is_noticed_and_gone_around_and_its_data_are_soon_back(loss: float) -> None:
    found = worst(outages(SEEDS, loss=loss))
    assert found.noticed < 1.5
    assert found.rerouted < 2.0
    assert found.data_back < 1.0
    assert found.frames_back < 1.0


def test_without_another_way_the_data_are_back_as_soon() -> None:
    found = worst(outages(SEEDS, third=False))
    assert found.data_back < 1.0
    assert found.frames_back < 1.0
