"""Routes in swarms that move at 10 m/s: the share of pairs whose next hops lead there, and what it costs.

The world and the brokers are those of test_directory_swarm. Four times a second all next hops are followed. A
pair counts that links with more than 85 % delivery connect; its route counts when each of its links delivers
20 % at least, so that repetitions carry a frame over it.
"""

import pytest
from tests.simulation.directory.swarm import Swarm

LEAST_DELIVERY = 0.2
WARM_S = 5


def fly(swarm: Swarm, seconds: int) -> tuple[float, float]:
    """Moves the swarm; share of pairs with a route, and bytes about the topology per second and node."""
    connected = arrived = 0
    for step in range(1, (WARM_S + seconds) * 4 + 1):
        swarm.run_for(0.25)
        swarm.assert_no_loop()
        if step == WARM_S * 4:
            for node in swarm.brokers.values():
                node.topology_bytes = 0
        if step > WARM_S * 4:
            pairs, routed = swarm.reached(LEAST_DELIVERY)
            connected += pairs
            arrived += routed
        swarm.move(0.25)
    topology_bytes = sum(node.topology_bytes for node in swarm.brokers.values())
    return arrived / connected, topology_bytes / len(swarm.names) / seconds


@pytest.mark.parametrize(
    ("seeds", "nodes", "seconds", "budget_bytes_s"),
    [(range(1, 5), 16, 10, 300), (range(1, 3), 50, 8, 600), (range(1, 2), 100, 4, 750)],
)
def test_swarms_at_10_m_s_have_their_routes(
    seeds: range, nodes: int, seconds: int, budget_bytes_s: int
) -> None:
    flights = [fly(Swarm(seed, nodes, speed_m_s=10.0), seconds) for seed in seeds]
    assert sum(routed for routed, _ in flights) / len(flights) >= 0.998, flights
    assert max(bytes_s for _, bytes_s in flights) <= budget_bytes_s, flights


@pytest.mark.parametrize(("seeds", "nodes", "seconds"), [(range(1, 5), 16, 15), (range(1, 2), 50, 8)])
def test_idle_swarms_at_10_m_s_have_nearly_all_their_routes(seeds: range, nodes: int, seconds: int) -> None:
    flights = [fly(Swarm(seed, nodes, speed_m_s=10.0, subscribed=False), seconds) for seed in seeds]
    assert sum(routed for routed, _ in flights) / len(flights) >= 0.99, flights
