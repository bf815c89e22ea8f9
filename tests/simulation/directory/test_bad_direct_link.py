"""A link that loses much between two nodes that a third one hears well: their routes lead over the third."""

import pytest
from tests.simulation.directory.link_loss import SETTLED_S, STEP_S, Triangle
from tests.simulation.seeds import seeds

LOSS = 0.6
LOOKS = 120
PAIRS = (("uav1", "uav2"), ("uav2", "uav1"))


@pytest.mark.parametrize("seed", seeds(2, 10))
def test_idle_nodes_avoid_link_with_heavy_loss(seed: int) -> None:
    swarm = Triangle(seed, busy=False)
    swarm.run_for(SETTLED_S)
    assert all(swarm.via(name, goal) == goal for name, goal in PAIRS)
    swarm.direct_loss = LOSS
    swarm.run_for(2 * SETTLED_S)  # windows of 16 beacons at 2 Hz
    for _ in range(LOOKS):
        swarm.run_for(100 * STEP_S)
        assert [swarm.via(name, goal) for name, goal in PAIRS] == ["uav3", "uav3"]


def test_recovered_direct_link_is_used_again() -> None:
    swarm = Triangle(1, busy=False)
    swarm.direct_loss = LOSS
    swarm.run_for(3 * SETTLED_S)
    assert swarm.via() == "uav3"
    swarm.direct_loss = 0.0
    swarm.run_for(3 * SETTLED_S)
    assert [swarm.via(name, goal) for name, goal in PAIRS] == ["uav2", "uav1"]
