"""Routes in swarms that move at 10 m/s: the share of pairs whose next hops lead there, and what it costs.

The world and the nodes are those of test_directory_swarm. Four times a second all next hops are followed. A
pair counts that links with more than 85 % delivery connect; its route counts when each of its links delivers
20 % at least, so that repetitions carry a frame over it.
"""

import pytest
from tests.simulation.directory.test_directory_swarm import SECOND, Swarm

from swarmd.broker.core.beacon.beacon_rate import CHANGING_HZ, IDLE_HZ
from swarmd.broker.core.topology.topology import Topology

LEAST_DELIVERY = 0.2
WARM_S = 5


class Idle(Swarm):
    """Nodes of which nobody wants a board."""

    def period_ns(self, topology: Topology) -> int:
        return round(SECOND / (CHANGING_HZ if topology.is_changing(self.now_ns) else IDLE_HZ))


def fly(swarm: Swarm, seconds: int) -> tuple[float, float]:
    """Moves the swarm; share of pairs with a route, and bytes of the directory per second and node."""
    connected = arrived = 0
    for step in range(1, (WARM_S + seconds) * 4 + 1):
        swarm.run(step * SECOND // 4)
        swarm.assert_no_loop()
        if step == WARM_S * 4:
            swarm.sent_bytes = 0
        if step > WARM_S * 4:
            pairs, routed = swarm.reached(LEAST_DELIVERY)
            connected += pairs
            arrived += routed
        swarm.move(0.25)
    return arrived / connected, swarm.sent_bytes / swarm.count / seconds


@pytest.mark.parametrize(
    ("seeds", "nodes", "seconds", "budget_bytes_s"),
    [(range(1, 5), 16, 10, 300), (range(1, 5), 50, 8, 600), (range(1, 3), 100, 6, 750)],
)
def test_swarms_at_10_m_s_have_their_routes(
    seeds: range, nodes: int, seconds: int, budget_bytes_s: int
) -> None:
    flights = [fly(Swarm(seed, nodes, SECOND // 10, speed_m_s=10.0), seconds) for seed in seeds]
    assert sum(routed for routed, _ in flights) / len(flights) >= 0.998, flights
    assert max(bytes_s for _, bytes_s in flights) <= budget_bytes_s


@pytest.mark.parametrize(("seeds", "nodes", "seconds"), [(range(1, 5), 16, 15), (range(1, 4), 50, 8)])
def test_idle_swarms_at_10_m_s_have_nearly_all_their_routes(seeds: range, nodes: int, seconds: int) -> None:
    flights = [fly(Idle(seed, nodes, SECOND // 2, speed_m_s=10.0), seconds) for seed in seeds]
    assert sum(routed for routed, _ in flights) / len(flights) >= 0.99, flights
