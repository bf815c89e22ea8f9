"""Brokers in virtual time, datagrams encoded as on the wire: poses of moving, lossy swarms.

Swarms of 16 nodes that all subscribe to all poses at 10 Hz: how old the poses are by distance, that every
platform's name and tree are known everywhere, and what it costs in bytes; the same of 100, and of 16 in one
cell.
"""

from collections import defaultdict

import numpy as np
import pytest
from tests.simulation.directory.air import Air
from tests.simulation.seeds import seeds

from swarmware.model.names import hardware_id


def test_poses_of_16_nodes_are_fresh_and_cheap() -> None:
    ages_s: dict[int, list[float]] = defaultdict(list)
    bytes_s: list[float] = []
    for seed in seeds(2, 5):
        air = Air(seed, count=16, degree=6.0, speed_m_s=5.0)
        air.run_for(4.0)
        warm_bytes = air.sent_bytes_all()
        air.fly(6.0, look=True)
        bytes_s.append((air.sent_bytes_all() - warm_bytes) / 16 / 6.0)
        assert max(air.ages_s) >= 3, "this seed shows nothing about many hops"
        for hops, found_s in air.ages_s.items():
            ages_s[hops] += found_s
        for node in air.brokers.values():
            refused = node.core.counters.refused
            assert (refused.unsigned_values, refused.unsigned, refused.impersonated) == (0, 0, 0)
        distances = air.distances()
        for index, name in enumerate(air.names):
            for other, platform in enumerate(air.names):
                if distances[index][other]:
                    member = air.brokers[name].core.nodes.get(hardware_id(platform))
                    assert member is not None
                    assert member.platform == platform
                    assert member.tree_version == hardware_id(platform) & 0xFFFF
    assert np.mean(bytes_s) <= 4700, "bytes per node and second"
    # of all swarms together: in one of them a single node at the edge decides about three hops
    for hops, limit_s in ((1, 0.15), (2, 0.3), (3, 0.9)):
        assert np.quantile(np.array(ages_s[hops]), 0.95) <= limit_s


@pytest.mark.slow
@pytest.mark.timeout(600)  # 15 s of an idle core
def test_poses_of_100_nodes_stay_within_their_bytes() -> None:
    air = Air(0, count=100, degree=9.0, speed_m_s=5.0)
    air.fly(4.0, look=False)  # until all names are known
    warm_bytes = air.sent_bytes_all()
    air.fly(1.0, look=True)
    per_node = (air.sent_bytes_all() - warm_bytes) / 100 / 1.0
    assert per_node <= 7200, "bytes per node and second"
    assert np.quantile(np.array(air.ages_s[1]), 0.95) <= 0.15
    assert np.quantile(np.array(air.ages_s[2]), 0.95) <= 0.32


def test_poses_in_one_cell_are_not_relayed() -> None:
    air = Air(1, count=16, degree=300.0, speed_m_s=0.0)
    air.run_for(3.0)
    warm_bytes = air.sent_bytes_all()
    air.run_for(6.0)  # three periods of hellos
    total = (air.sent_bytes_all() - warm_bytes) / 6.0
    assert total <= 27_000, "bytes per second of all 16 together"
    air.look()
    assert set(air.ages_s) == {1}
    assert max(air.ages_s[1]) < 0.5
