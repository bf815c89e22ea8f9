"""Boot storm: all nodes of a cell start within one second; soon each has a route to each other."""

import pytest
from tests.simulation.directory.boot_storm import converged_s, falls
from tests.simulation.seeds import seeds


@pytest.mark.parametrize("seed", seeds(2, 20))
@pytest.mark.parametrize(("loss", "within_s"), [(0.0, 3.0), (0.02, 3.0), (0.3, 6.0)])
def test_sixteen_nodes_that_start_within_a_second_reach_each_other_soon(
    seed: int, loss: float, within_s: float
) -> None:
    assert converged_s(seed, loss) <= within_s


@pytest.mark.parametrize("seed", seeds(1, 5))
def test_the_links_of_sixteen_quiet_nodes_do_not_flap_at_a_loss_of_30_percent(seed: int) -> None:
    found = falls(seed, 0.3, before_s=20.0, lasts_s=60.0)
    assert found <= 24, "of 240 links in a minute"
