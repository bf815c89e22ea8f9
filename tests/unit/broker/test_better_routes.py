"""Better routes that are not feasible: requests to one neighbour, and numbers held for the sake of others."""

from typing import Final

import pytest

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, Header, Hello, NeighbourRequest, PlatformCode, RouteRow
from swarmd.broker.core.beacon.request_parts import encode_requests, request_part_bytes
from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.broker.core.swarm.routes.destination_routes import HELD_NS, is_much_worse
from swarmd.broker.core.swarm.routes.routing_table import (
    FORWARD_AGAIN_NS,
    REQUEST_HOPS,
    REQUESTS_MAX,
    SEEK_AFTER_NS,
    SEEK_AGAIN_NS,
    SEEK_OTHER_NS,
    RouteChanged,
    RoutingTable,
)
from swarmd.broker.core.swarm.topology import Topology
from swarmware.errors import WireError

ME, A, B, C, FAR = 1, 2, 3, 4, 9
SECOND: Final = 1_000_000_000
NOBODY: Final[frozenset[int]] = frozenset()


@pytest.fixture
def routing() -> RoutingTable:
    """A node with three neighbours."""
    routing = RoutingTable(ME)
    for neighbour in (A, B, C):
        routing.set_link(neighbour, 256)
    return routing


def row(routing: RoutingTable, now_ns: int) -> RouteRow | None:
    return next((one for one in routing.rows(now_ns, 60, NOBODY) if one.hw == FAR), None)


def advertised(routing: RoutingTable, metric: int, sequence: int = 7) -> None:
    """The node has advertised a route over A."""
    routing.on_rows(A, [(FAR, sequence, metric)], 0)
    assert row(routing, 0) == RouteRow(FAR, sequence, metric + 256)


def after_the_rise(routing: RoutingTable, risen_ns: int) -> tuple[NeighbourRequest, ...]:
    """The requests of the beacons after a metric rose."""
    routing.advance(risen_ns + SEEK_AFTER_NS - 1)
    assert routing.neighbour_requests() == (), "those whose routes lead back do not have the rise yet"
    routing.advance(risen_ns + SEEK_AFTER_NS)
    return routing.neighbour_requests()


# the node that asks


def test_better_infeasible_route_is_requested_of_neighbour(
    routing: RoutingTable,
) -> None:
    advertised(routing, 4000)
    assert routing.on_rows(B, [(FAR, 6, 1000)], 1) == [], "older than what was advertised: it may lead back"
    assert routing.neighbour_requests() == (NeighbourRequest(B, FAR, 8, REQUEST_HOPS),)
    assert routing.neighbour_requests() == (), "in one beacon"
    assert routing.on_rows(B, [(FAR, 8, 1000)], 2) == [RouteChanged(FAR, B)], "the answer"


def test_route_that_is_hardly_better_is_not_requested(routing: RoutingTable) -> None:
    advertised(routing, 4000)
    routing.on_rows(B, [(FAR, 6, 3500)], 1)
    assert routing.neighbour_requests() == ()


def test_slightly_better_route_is_not_requested(routing: RoutingTable) -> None:
    advertised(routing, 300)
    routing.on_rows(B, [(FAR, 6, 100)], 1)
    assert routing.neighbour_requests() == ()


def test_the_same_destination_is_requested_now_and_then(routing: RoutingTable) -> None:
    advertised(routing, 4000)
    for now_ns in range(0, SEEK_AGAIN_NS, SECOND // 10):
        routing.on_rows(B, [(FAR, 6, 1000)], now_ns)
    assert len(routing.neighbour_requests()) == 1
    routing.on_rows(B, [(FAR, 6, 1000)], SEEK_AGAIN_NS)
    assert len(routing.neighbour_requests()) == 1


def test_route_that_becomes_worse_requests_best_of_others(routing: RoutingTable) -> None:
    advertised(routing, 256)
    routing.on_rows(B, [(FAR, 6, 900)], 1)
    routing.on_rows(C, [(FAR, 6, 700)], 1)
    assert routing.neighbour_requests() == ()
    routing.set_link(A, 8192)
    assert routing.worsen(A, 2) == []
    assert after_the_rise(routing, 2) == (NeighbourRequest(C, FAR, 8, REQUEST_HOPS),)


def test_neighbour_whose_route_leads_back_is_not_asked(routing: RoutingTable) -> None:
    advertised(routing, 256)
    routing.on_rows(B, [(FAR, 6, 900)], 1)
    routing.on_rows(C, [(FAR, 7, 768)], 1)  # over this node
    routing.set_link(A, 8192)
    routing.worsen(A, 2)
    assert row(routing, 3) == RouteRow(FAR, 7, 8448)
    routing.on_rows(C, [(FAR, 7, 8704)], 100)  # it has the rise
    assert after_the_rise(routing, 2) == (NeighbourRequest(B, FAR, 8, REQUEST_HOPS),)


def test_where_the_metric_fell_again_nobody_is_asked(routing: RoutingTable) -> None:
    advertised(routing, 256)
    routing.on_rows(B, [(FAR, 6, 900)], 1)
    routing.on_rows(A, [(FAR, 8, 8000)], 2)
    routing.on_rows(A, [(FAR, 9, 256)], 3)
    assert after_the_rise(routing, 2) == ()


def test_route_lost_since_rise_is_not_requested(routing: RoutingTable) -> None:
    advertised(routing, 256)
    routing.set_link(A, 8192)
    routing.worsen(A, 2)
    routing.on_rows(B, [(FAR, 6, 900)], 3)
    assert routing.drop_link(A, 3) == [RouteChanged(FAR, 0)]
    routing.neighbour_requests()
    assert after_the_rise(routing, 2) == ()


def test_another_neighbour_is_asked_before_same_again(routing: RoutingTable) -> None:
    advertised(routing, 4000)
    routing.on_rows(B, [(FAR, 6, 1000)], 0)
    routing.on_rows(C, [(FAR, 6, 500)], SEEK_OTHER_NS - 1)
    assert [one.neighbour_hw for one in routing.neighbour_requests()] == [B]
    routing.on_rows(C, [(FAR, 6, 500)], SEEK_OTHER_NS)
    assert [one.neighbour_hw for one in routing.neighbour_requests()] == [C]
    routing.on_rows(C, [(FAR, 6, 500)], SEEK_AGAIN_NS)
    assert routing.neighbour_requests() == (), "a second after its own request"


def test_a_beacon_has_a_limit_of_requests(routing: RoutingTable) -> None:
    many = range(100, 100 + 3 * REQUESTS_MAX)
    routing.on_rows(A, [(hw, 7, 4000) for hw in many], 0)
    for now_ns in range(5):
        routing.rows(now_ns, 60, NOBODY)
    routing.on_rows(B, [(hw, 6, 1000) for hw in many], 1)
    assert len(routing.neighbour_requests()) == REQUESTS_MAX


# the node that is asked


def test_node_with_newer_row_answers_in_next_beacon(routing: RoutingTable) -> None:
    advertised(routing, 256)
    routing.on_rows(A, [(FAR, 9, 256)], 1)
    assert row(routing, 2) is None
    routing.on_neighbour_requests(B, [NeighbourRequest(ME, FAR, 8, 24)], 3)
    assert routing.neighbour_requests() == ()
    assert row(routing, 4) == RouteRow(FAR, 9, 512)
    assert row(routing, 5) is None, "once: the other asks again if it was lost"


def test_node_without_row_asks_next_hop_and_relays(routing: RoutingTable) -> None:
    advertised(routing, 256)
    routing.on_neighbour_requests(B, [NeighbourRequest(ME, FAR, 8, 24)], 1)
    assert routing.neighbour_requests() == (NeighbourRequest(A, FAR, 8, 23),)
    assert row(routing, 2) is None
    routing.on_rows(A, [(FAR, 8, 256)], 3)
    assert row(routing, 4) == RouteRow(FAR, 8, 512)


def test_requests_for_the_same_row_are_forwarded_once(routing: RoutingTable) -> None:
    advertised(routing, 256)
    for now_ns in range(0, FORWARD_AGAIN_NS, FORWARD_AGAIN_NS // 10):
        routing.on_neighbour_requests(B, [NeighbourRequest(ME, FAR, 8, 24)], now_ns)
        routing.on_neighbour_requests(C, [NeighbourRequest(ME, FAR, 9, 24)], now_ns)
    assert len(routing.neighbour_requests()) == 1


@pytest.mark.parametrize(
    ("via", "request_"),
    [
        (B, NeighbourRequest(C, FAR, 8, 24)),
        (B, NeighbourRequest(ME, 77, 8, 24)),
        (B, NeighbourRequest(ME, FAR, 8, 1)),
        (B, NeighbourRequest(ME, FAR, 8, 0)),
        (A, NeighbourRequest(ME, FAR, 8, 24)),
    ],
    ids=["to another", "unknown", "last hop", "no hop", "from the next hop"],
)
def test_a_request_that_leads_nowhere_is_not_forwarded(
    routing: RoutingTable, via: int, request_: NeighbourRequest
) -> None:
    advertised(routing, 256)
    routing.on_neighbour_requests(via, [request_], 1)
    assert routing.neighbour_requests() == ()


def test_no_request_travels_farther_than_limit_of_hops(routing: RoutingTable) -> None:
    advertised(routing, 256)
    routing.on_neighbour_requests(B, [NeighbourRequest(ME, FAR, 8, 255)], 1)
    assert routing.neighbour_requests() == (NeighbourRequest(A, FAR, 8, REQUEST_HOPS),)


def test_the_destination_itself_raises_its_number(routing: RoutingTable) -> None:
    routing.on_neighbour_requests(A, [NeighbourRequest(B, ME, 4, 24)], 1)
    assert routing.requested_sequence is None
    routing.on_neighbour_requests(A, [NeighbourRequest(ME, ME, 5, 24)], 1)
    assert routing.requested_sequence == 5


def test_requests_of_unlinked_nodes_are_ignored() -> None:
    topology = Topology(ME, 100, SECOND, -1)
    hello = Hello(1, 0, 1, 1, 0, PlatformCode.UAV, "uav2")
    beacon = Beacon(hello, neighbour_requests=(NeighbourRequest(ME, ME, 5000, 24),))
    update = topology.on_beacon(Header(0, A, 1, 0, 1), beacon, False, ("10.0.0.2", 1), 1)
    assert update is not None
    assert update.neighbour.state is LinkState.HEARD
    assert topology.next_sequence() == 101


# numbers that are held


def test_worsened_route_keeps_number_for_feasible_others(
    routing: RoutingTable,
) -> None:
    advertised(routing, 256)
    routing.set_link(A, 8192)
    routing.worsen(A, 1)
    routing.on_rows(A, [(FAR, 40, 256)], 2)
    assert row(routing, 3) == RouteRow(FAR, 7, 8448), "the metric at once, the number as before"
    assert routing.on_rows(B, [(FAR, 20, 1000)], 4) == [RouteChanged(FAR, B)], "20 is newer than 7"
    assert row(routing, 5 * SECOND) == RouteRow(FAR, 20, 1256)


def test_number_is_held_for_seconds_and_then_rises(routing: RoutingTable) -> None:
    advertised(routing, 256)
    routing.set_link(A, 8192)
    routing.worsen(A, 1)
    routing.on_rows(A, [(FAR, 40, 256)], 2)
    assert row(routing, 3) == RouteRow(FAR, 7, 8448)
    routing.on_rows(A, [(FAR, 90, 256)], HELD_NS + 3)
    assert row(routing, HELD_NS + 3) == RouteRow(FAR, 90, 8448), "who has no other needs it"
    routing.on_rows(A, [(FAR, 99, 256)], 2 * HELD_NS)
    assert row(routing, 2 * HELD_NS) == RouteRow(FAR, 99, 8448)


def test_little_worse_is_advertised_with_newest_number(routing: RoutingTable) -> None:
    advertised(routing, 1000)
    assert not is_much_worse(1800, 1256)
    routing.on_rows(A, [(FAR, 40, 1544)], 2)
    assert row(routing, 5 * SECOND) == RouteRow(FAR, 40, 1800)


# rises that are advertised at once


def test_a_rise_by_half_is_advertised_at_once(routing: RoutingTable) -> None:
    advertised(routing, 4000 - 256)
    routing.on_rows(A, [(FAR, 8, 5900)], 1)
    assert row(routing, 2) is None, "6156 of 4000: with the next regular row"
    routing.on_rows(A, [(FAR, 9, 6000)], 3)
    assert row(routing, 4) == RouteRow(FAR, 9, 6256)


def test_much_worse_next_hop_waits(routing: RoutingTable) -> None:
    advertised(routing, 4000 - 256)
    routing.on_rows(B, [(FAR, 8, 6000)], 1)
    assert routing.drop_link(A, 2) == [RouteChanged(FAR, B)]
    assert row(routing, 3) is None


# in the beacon


def test_requests_to_one_neighbour_share_its_address() -> None:
    requests = (
        NeighbourRequest(A, FAR, 8, 24),
        NeighbourRequest(A, 10, 9, 3),
        NeighbourRequest(B, FAR, 8, 1),
    )
    data = encode_requests(requests)
    assert len(data) == request_part_bytes(requests) == 3 + 5 + 7 + 7 + 5 + 7
    assert data[:8] == bytes((8, 31, 0)) + A.to_bytes(4, "little") + bytes((2,))
    assert request_part_bytes(()) == 0
    assert codec.decode(codec.encode(Beacon(neighbour_requests=requests))).neighbour_requests == requests


@pytest.mark.parametrize("cut", [1, 6, 8, 11])
def test_part_that_ends_within_request_is_refused(cut: int) -> None:
    body = bytearray(codec.encode(Beacon(neighbour_requests=(NeighbourRequest(A, FAR, 8, 24),))))
    del body[-cut:]
    body[2] -= cut
    with pytest.raises(WireError, match="cut short"):
        codec.decode(bytes(body))
