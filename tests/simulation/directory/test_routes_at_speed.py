"""Routes in swarms that move at 10 m/s: the share of pairs whose next hops lead there, and what it costs.

World and brokers come from test_directory_swarm, and the figures are the figures of table.py over shorter
flights.
"""

import pytest
from tests.simulation.directory.flight import fly
from tests.simulation.directory.swarm import Swarm
from tests.simulation.seeds import cases

WARM_S = 6


@pytest.mark.parametrize(
    ("seeds", "nodes", "seconds", "budget_bytes_s"),
    cases(
        [(range(1, 3), 16, 6, 240), (range(1, 2), 50, 4, 450)],
        [(range(1, 5), 16, 10, 240), (range(1, 3), 50, 8, 450), (range(1, 2), 100, 4, 720)],
    ),
)
def test_swarms_at_10_m_s_have_their_routes(
    seeds: range, nodes: int, seconds: int, budget_bytes_s: int
) -> None:
    flights = [fly(Swarm(seed, nodes, speed_m_s=10.0), WARM_S, seconds) for seed in seeds]
    assert sum(flight.routed_ratio for flight in flights) / len(flights) >= 0.998, flights
    assert sum(flight.directory_bytes_s for flight in flights) / len(flights) <= budget_bytes_s, flights


@pytest.mark.parametrize(
    ("seeds", "nodes", "seconds"),
    cases([(range(1, 3), 16, 8)], [(range(1, 5), 16, 15), (range(1, 2), 50, 8)]),
)
def test_idle_swarms_in_motion_have_nearly_all_routes(seeds: range, nodes: int, seconds: int) -> None:
    flights = [fly(Swarm(seed, nodes, speed_m_s=10.0, subscribed=False), WARM_S, seconds) for seed in seeds]
    assert sum(flight.routed_ratio for flight in flights) / len(flights) >= 0.99, flights
