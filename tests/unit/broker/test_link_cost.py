"""The cost of a link: loss of both directions, the round trip, and the rate of its medium."""

import pytest

from swarmd.broker.core.swarm.links.link import COST_MAX, link_cost
from swarmd.broker.core.swarm.neighbour import Neighbour
from swarmd.broker.core.swarm.routes.routing_table import RouteChanged, RoutingTable

MS = 1_000_000


@pytest.fixture
def neighbour() -> Neighbour:
    """A link without loss."""
    found = Neighbour(20, 0)
    found.window = -1
    return found


@pytest.mark.parametrize(
    ("rtt_ms", "penalty", "cost"),
    [(0, 0, 256), (10, 0, 256), (20, 0, 256), (50, 0, 288), (65, 0, 304), (130, 0, 352), (5, 512, 768)],
)
def test_cost_counts_the_round_trip_and_the_rate(
    neighbour: Neighbour, rtt_ms: int, penalty: int, cost: int
) -> None:
    neighbour.rtt_ns, neighbour.penalty = rtt_ms * MS, penalty
    assert neighbour.cost == pytest.approx(cost, abs=16)


def test_a_slow_medium_never_makes_a_link_unusable(neighbour: Neighbour) -> None:
    neighbour.penalty = 10 * COST_MAX
    assert neighbour.cost == COST_MAX


def test_lossless_way_with_shorter_round_trips_is_used() -> None:
    slow, fast = (link_cost(255, 255, 0, rtt_ms * MS) for rtt_ms in (130, 5))
    routing = RoutingTable(1)
    routing.set_link(2, slow)
    routing.set_link(3, fast)
    assert routing.on_rows(2, [(9, 7, slow)], 0) == [RouteChanged(9, 2)]
    assert routing.on_rows(3, [(9, 7, fast)], 1) == [RouteChanged(9, 3)]
