"""Links at the edge of their range: beacons are lost at random, and the link neither flaps nor stays dead."""

from typing import Final

import numpy as np
import pytest
from tests.simulation.directory.swarm import Swarm
from tests.simulation.seeds import seeds

from swarmd.broker.core.frames.carrier_choice import LOSSY
from swarmd.broker.core.swarm.links.link import LinkState

BEFORE_S: Final = 20.0
LASTS_S: Final = 240.0
NEW: Final = 40


def flaps(seed: int, loss: float, *, subscribed: bool) -> tuple[int, bool]:
    """How often the link between two nodes that stand together fell, and whether it is up at the end."""
    swarm = Swarm(seed, 2, speed_m_s=0.0, loss=loss, subscribed=subscribed)
    swarm.place(np.zeros((2, 2)))
    swarm.run_for(BEFORE_S)
    nodes = list(swarm.brokers.values())
    for node in nodes:
        node.links.clear()
    swarm.run_for(LASTS_S)
    fell = sum(change.before is LinkState.UP for node in nodes for change in node.links)
    table = [node.core.report.routes().routes for node in nodes]
    return fell, all(table)


@pytest.mark.parametrize("seed", seeds(1, 10))
@pytest.mark.parametrize("subscribed", [True, False])
@pytest.mark.parametrize(("loss", "most"), [(0.3, 0), (0.4, 2)])
def test_a_link_that_loses_beacons_does_not_flap(seed: int, subscribed: bool, loss: float, most: int) -> None:
    fell, up = flaps(seed, loss, subscribed=subscribed)
    assert fell <= most
    assert up


def test_link_that_loses_nearly_everything_is_taken_down() -> None:
    fell, _ = flaps(1, 0.85, subscribed=True)
    assert fell > 0


def test_loss_of_new_links_is_known_within_second() -> None:
    known = 0
    for seed in range(NEW):
        swarm = Swarm(seed, 2, speed_m_s=0.0, loss=0.4)
        swarm.place(np.zeros((2, 2)))
        swarm.run_for(1.0)
        qualities = [
            one
            for node in swarm.brokers.values()
            for one in node.core.report.link_qualities(node.clock.now_ns())
        ]
        known += any(quality.loss > LOSSY for _, quality in qualities)
    assert known > NEW / 2
