"""Links of nodes without subscriptions, whose beacons are rare: they stay up where beacons are lost."""

import pytest
from tests.simulation.directory.storm import Storm
from tests.simulation.seeds import seeds

from swarmd.broker.core.swarm.links.link import LinkState

BEFORE_S = 20.0
LASTS_S = 60.0


@pytest.mark.parametrize("seed", seeds(1, 5))
def test_sixteen_quiet_lossy_links_do_not_flap(seed: int) -> None:
    swarm = Storm(seed, 16, loss=0.3, subscribed=False)
    swarm.run_for(BEFORE_S)
    nodes = swarm.started.values()
    for node in nodes:
        node.links.clear()
    swarm.run_for(LASTS_S)
    fell = sum(change.before is LinkState.UP for node in nodes for change in node.links)
    assert fell <= 24, "of 240 links in a minute"
