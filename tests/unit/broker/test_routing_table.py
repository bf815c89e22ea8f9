"""The directory's decisions in tables; whole swarms fly in tests/simulation/directory."""

from typing import Final

import pytest

from swarmd.broker.core.beacon.beacon import INFINITY, LOST, Beacon, Header, RouteRow, SequenceRequest
from swarmd.broker.core.swarm.routes.destination_routes import newer
from swarmd.broker.core.swarm.routes.routing_table import (
    DESTINATION_LIMIT,
    HOLD_NS,
    HYSTERESIS,
    REFRESH_MAX_NS,
    REFRESH_NS,
    REQUEST_HOPS,
    SOURCE_GC_NS,
    Route,
    RouteChanged,
    RoutingTable,
)
from swarmd.broker.core.swarm.topology import Topology

ME, A, B, FAR = 1, 2, 3, 9
SECOND: Final = 1_000_000_000
PERIOD: Final = SECOND // 10
NOBODY: Final[frozenset[int]] = frozenset()


@pytest.fixture
def routing() -> RoutingTable:
    routing = RoutingTable(ME)
    routing.set_link(A, 256)
    routing.set_link(B, 256)
    return routing


def rows(routing: RoutingTable, now_ns: int = 0, linked: frozenset[int] = NOBODY) -> dict[int, RouteRow]:
    return {row.hw: row for row in routing.rows(now_ns, 60, linked)}


@pytest.mark.parametrize(
    ("one", "other", "is_newer"),
    [(1, 0, True), (0, 1, False), (5, 5, False), (0, 0xFFFF, True), (0x7FFF, 0, True), (0x8000, 0, False)],
)
def test_sequence_numbers_compare_modulo_2_to_the_16(one: int, other: int, is_newer: bool) -> None:
    assert newer(one, other) is is_newer


def test_row_of_neighbour_is_route_over_it(routing: RoutingTable) -> None:
    assert routing.on_rows(A, [(FAR, 7, 512)], 5) == [RouteChanged(FAR, A)]
    assert routing.next_hop(FAR) == A
    assert routing.routes() == [Route(FAR, A, 768, 7, 5)]


def test_rows_of_who_is_no_neighbour_count_nothing(routing: RoutingTable) -> None:
    assert routing.on_rows(77, [(FAR, 7, 512)], 0) == []
    assert routing.next_hop(FAR) == 0


def test_the_better_of_two_neighbours_is_taken(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 1000)], 0)
    assert routing.on_rows(B, [(FAR, 7, 512)], 0) == [RouteChanged(FAR, B)]


def test_a_little_better_is_not_enough_to_change(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 512)], 0)
    assert routing.on_rows(B, [(FAR, 7, 512 - HYSTERESIS)], 0) == []
    assert routing.on_rows(B, [(FAR, 8, 511 - HYSTERESIS)], 0) == [RouteChanged(FAR, B)]


def test_what_was_advertised_bounds_what_is_taken_later(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 512)], 0)
    assert rows(routing)[FAR] == RouteRow(FAR, 7, 768)
    routing.drop_link(A, 1)
    # as long as the way it was, or longer: it may lead through us
    assert routing.on_rows(B, [(FAR, 7, 768)], 1) == []
    assert routing.on_rows(B, [(FAR, 6, 1)], 1) == []
    # a shorter route cannot lead back, nor can a newer one
    assert routing.on_rows(B, [(FAR, 7, 767)], 1) == [RouteChanged(FAR, B)]


def test_a_newer_sequence_is_taken_at_any_distance(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 0xFFFF, 1)], 0)
    rows(routing)
    routing.drop_link(A, 1)
    assert routing.on_rows(B, [(FAR, 0, 5000)], 1) == [RouteChanged(FAR, B)]


def test_longer_way_is_announced_at_once(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    rows(routing)
    assert routing.on_rows(A, [(FAR, 7, 1100)], 1) == [], "not feasible, but ours stays loop-free"
    assert rows(routing, 2)[FAR] == RouteRow(FAR, 7, 1356)
    assert routing.on_rows(B, [(FAR, 7, 512)], 3) == [], "the feasibility distance did not change"


def test_much_longer_way_is_left_for_another(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    routing.on_rows(B, [(FAR, 7, 300)], 0)
    assert routing.on_rows(A, [(FAR, 8, 2000)], 1) == [RouteChanged(FAR, B)]


def test_a_retraction_takes_the_other_way_or_none(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    routing.on_rows(B, [(FAR, 7, 300)], 0)
    assert routing.on_rows(A, [(FAR, 7, INFINITY)], 1) == [RouteChanged(FAR, B)]
    assert routing.on_rows(B, [(FAR, 7, INFINITY)], 2) == [RouteChanged(FAR, 0)]


def test_lost_route_is_said_twice_and_asked_for(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    rows(routing)
    routing.drop_link(A, 1)
    for slot in range(2):
        assert rows(routing, slot * PERIOD + 1)[FAR].metric == INFINITY
    assert FAR not in rows(routing, 3 * PERIOD)
    assert routing.requests(2) == (SequenceRequest(FAR, 8, REQUEST_HOPS | LOST),)
    assert routing.requests(3) == (), "not in every beacon"
    assert routing.requests(SECOND) != ()
    assert routing.requests(10 * SECOND) == (), "not for ever"


def test_lost_requester_leads_nowhere(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    routing.on_rows(B, [(FAR, 7, 300)], 0)
    assert routing.on_requests(A, [SequenceRequest(FAR, 8, 20)], 1) == [], "it only passes it on"
    changes = routing.on_requests(A, [SequenceRequest(FAR, 8, 20 | LOST)], 1)
    assert changes == [RouteChanged(FAR, B)], "its retractions were lost"


def test_request_is_relayed_once_with_one_hop_less(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    routing.on_requests(B, [SequenceRequest(FAR, 8, 20 | LOST)], 1)
    routing.on_requests(B, [SequenceRequest(FAR, 8, 20 | LOST)], 2)
    assert routing.requests(3) == (SequenceRequest(FAR, 8, 19),)


def test_a_request_at_its_last_hop_ends(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    routing.on_requests(B, [SequenceRequest(FAR, 8, 1)], 1)
    assert routing.requests(2) == ()


def test_node_with_newer_row_answers_without_forwarding(
    routing: RoutingTable,
) -> None:
    routing.on_rows(A, [(FAR, 9, 256)], 0)
    rows(routing)
    assert rows(routing, PERIOD) == {}
    routing.on_requests(B, [SequenceRequest(FAR, 8, 20)], PERIOD)
    assert routing.requests(PERIOD) == ()
    assert FAR in rows(routing, 2 * PERIOD)
    assert FAR not in rows(routing, 2 * PERIOD + 1)


def test_awaited_row_is_announced_on_arrival(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    rows(routing)
    routing.on_requests(B, [SequenceRequest(FAR, 8, 20)], 1)
    assert rows(routing, 2) == {}
    routing.on_rows(A, [(FAR, 8, 256)], 3)
    assert rows(routing, 4)[FAR].sequence == 8


def test_a_request_for_ourselves_raises_our_own_number(routing: RoutingTable) -> None:
    routing.on_requests(A, [SequenceRequest(ME, 5, 20)], 0)
    assert routing.requested_sequence == 5


def test_rows_are_refreshed_slower_farther_they_lead(routing: RoutingTable) -> None:
    routing.on_rows(A, [(A, 1, 0), (FAR, 1, 800)], 0)
    rows(routing, 0)
    routing.on_rows(A, [(A, 2, 0), (FAR, 2, 800)], 1)
    assert set(rows(routing, REFRESH_NS)) == {A}
    routing.on_rows(A, [(A, 3, 0)], REFRESH_NS)
    assert set(rows(routing, 4 * REFRESH_NS)) == {A, FAR}


def test_row_is_repeated_only_with_next_number(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 1, 0)], 0)
    rows(routing, 0)
    assert rows(routing, REFRESH_NS + PERIOD) == {}, "it would say the same"
    routing.on_rows(A, [(FAR, 2, 0)], REFRESH_NS + PERIOD)
    assert rows(routing, REFRESH_NS + PERIOD)[FAR].sequence == 2
    assert rows(routing, 2 * REFRESH_NS) == {}
    assert FAR in rows(routing, 3 * REFRESH_NS), "a neighbour may have missed it, or be new"


def test_unneeded_rows_are_sent_once_and_on_request(routing: RoutingTable) -> None:
    routing.on_rows(A, [(A, 1, 0)], 0)
    everybody = frozenset((A,))
    assert set(rows(routing, 0, everybody)) == {A}
    assert rows(routing, 3600 * SECOND, everybody) == {}
    routing.on_requests(B, [SequenceRequest(A, 1, 20)], 3600 * SECOND)
    assert set(rows(routing, 3600 * SECOND + 1, everybody)) == {A}


@pytest.mark.parametrize(("metric", "at_once"), [(3000, False), (500, True)])
def test_turned_route_is_announced_when_much_better(
    routing: RoutingTable, metric: int, at_once: bool
) -> None:
    routing.on_rows(A, [(FAR, 7, 4000)], 0)
    rows(routing)
    assert routing.on_rows(B, [(FAR, 7, metric)], 1) == [RouteChanged(FAR, B)]
    assert (FAR in rows(routing, 2)) is at_once
    assert at_once or rows(routing, 2 * REFRESH_MAX_NS)[FAR] == RouteRow(FAR, 7, metric + 256)


def test_newly_needed_row_is_announced_at_once(routing: RoutingTable) -> None:
    routing.on_rows(A, [(A, 1, 0)], 0)
    rows(routing, 0, frozenset((A,)))
    assert rows(routing, 1, frozenset((A,))) == {}
    assert set(rows(routing, 2)) == {A}
    assert rows(routing, 3) == {}


def test_lost_routes_go_first_when_room_is_short(routing: RoutingTable) -> None:
    routing.on_rows(A, [(hw, 1, 256) for hw in range(100, 140)], 0)
    rows(routing)
    routing.on_rows(A, [(120, 1, INFINITY)], 1)
    assert routing.rows(10 * SECOND, 3, NOBODY)[0] == RouteRow(120, 1, INFINITY)


def test_a_route_whose_number_stands_still_is_lost(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    for now_ns in range(0, HOLD_NS + 1, SECOND):
        assert routing.on_rows(A, [(FAR, 7, 256)], now_ns) == []
        assert routing.advance(now_ns) == []
    assert routing.advance(HOLD_NS + 2 * SECOND) == [RouteChanged(FAR, 0)]


def test_a_vanished_node_is_forgotten_with_its_bound(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    rows(routing)
    routing.drop_link(A, 1)
    routing.set_link(A, 256)
    routing.advance(2)
    routing.advance(SOURCE_GC_NS + 3 * SECOND)
    assert routing.on_rows(A, [(FAR, 3, 5000)], SOURCE_GC_NS + 4 * SECOND) == [RouteChanged(FAR, A)]


def test_traffic_for_lost_node_asks_for_it_again(routing: RoutingTable) -> None:
    routing.on_rows(A, [(FAR, 7, 256)], 0)
    rows(routing)
    routing.drop_link(A, 1)
    routing.requests(20 * SECOND)
    routing.request_route(FAR, 20 * SECOND)
    assert routing.requests(20 * SECOND) == (SequenceRequest(FAR, 8, REQUEST_HOPS | LOST),)


def test_a_metric_never_reaches_infinity_by_adding_up(routing: RoutingTable) -> None:
    assert routing.on_rows(A, [(FAR, 7, INFINITY - 256)], 0) == []
    assert routing.on_rows(A, [(FAR, 7, INFINITY - 257)], 0) == [RouteChanged(FAR, A)]


def test_destinations_beyond_the_limit_are_not_taken(routing: RoutingTable) -> None:
    routing.on_rows(A, [(1000 + index, 1, 1) for index in range(DESTINATION_LIMIT + 5)], 0)
    assert len(routing.routes()) == DESTINATION_LIMIT


def header(hw: int, sequence: int) -> Header:
    return Header(0, hw, sequence, 0)


def bring_up(topology: Topology, hw: int, sequence: int, now_ns: int) -> None:
    """Hears a node that has heard our newest datagram."""
    ours = topology.next_sequence()
    topology.sent(ours, now_ns)
    topology.on_beacon(header(hw, sequence), Beacon(), False, ("h", 1), now_ns)
    echo = Beacon(echoes=((topology.own_hw, ours & 0xFF, 0, 255),))  # type: ignore[arg-type]  # a plain tuple will do
    topology.on_beacon(header(hw, sequence + 1), echo, False, ("h", 1), now_ns)


def test_neighbour_is_route_to_itself_once_up() -> None:
    topology = Topology(ME, 100, SECOND, 0)
    bring_up(topology, A, 5, 0)
    assert topology.routing.next_hop(A) == A


def test_routes_over_a_neighbour_end_with_its_silence() -> None:
    topology = Topology(ME, 100, SECOND, 0)
    bring_up(topology, A, 5, 0)
    topology.on_beacon(header(A, 7), Beacon(rows=(RouteRow(FAR, 1, 256),)), False, ("h", 1), PERIOD)
    deadline_ns = topology.deadline_ns()
    assert deadline_ns is not None
    links, routes = topology.advance(deadline_ns)
    assert [link.hw for link in links] == [A]
    assert {route.hw for route in routes} == {A, FAR}


def test_started_node_reaches_only_neighbours_at_first() -> None:
    topology = Topology(ME, 100, SECOND, quiet_until_ns=SECOND)
    bring_up(topology, A, 5, 0)
    beacon = Beacon(rows=(RouteRow(FAR, 1, 256),))
    topology.on_beacon(header(A, 7), beacon, False, ("h", 1), SECOND - 1)
    assert (topology.routing.next_hop(A), topology.routing.next_hop(FAR)) == (A, 0)
    topology.on_beacon(header(A, 8), beacon, False, ("h", 1), SECOND)
    assert topology.routing.next_hop(FAR) == A


def test_rows_of_an_overtaken_datagram_are_not_used() -> None:
    topology = Topology(ME, 100, SECOND, 0)
    bring_up(topology, A, 5, 0)
    topology.on_beacon(header(A, 8), Beacon(rows=(RouteRow(FAR, 2, INFINITY),)), False, ("h", 1), PERIOD)
    topology.on_beacon(header(A, 7), Beacon(rows=(RouteRow(FAR, 1, 256),)), False, ("h", 1), PERIOD)
    assert topology.routing.next_hop(FAR) == 0


def test_restarted_neighbours_routes_are_dropped_first() -> None:
    topology = Topology(ME, 100, SECOND, 0)
    bring_up(topology, A, 5, 0)
    topology.on_beacon(header(A, 7), Beacon(rows=(RouteRow(FAR, 1, 256),)), False, ("h", 1), PERIOD)
    heard = topology.on_beacon(
        header(A, 900), Beacon(rows=(RouteRow(FAR, 2, 256),)), True, ("h", 1), 2 * PERIOD
    )
    assert heard is not None
    assert RouteChanged(FAR, 0) in heard.routes
    assert topology.routing.next_hop(FAR) == 0, "it has not said yet that it hears us"


def test_own_numbers_continue_from_what_others_hold() -> None:
    topology = Topology(ME, 100, SECOND, 0)
    assert topology.next_sequence() == 101
    topology.routing.requested_sequence = 5000
    assert topology.next_sequence() == 5001
    topology.routing.requested_sequence = 4000
    assert topology.next_sequence() == 5002, "older than ours: of no interest"


def test_hardly_better_neighbour_does_not_replace_route(
    routing: RoutingTable,
) -> None:
    routing.on_rows(A, [(FAR, 7, 512)], 0)
    routing.on_rows(B, [(FAR, 7, 512)], 0)
    routing.set_link(A, 256 + HYSTERESIS // 2)
    assert routing.worsen(A, PERIOD) == []
    assert routing.next_hop(FAR) == A, "swarms would turn their routes with each datagram lost"
    routing.set_link(A, 256 + 2 * HYSTERESIS)
    assert routing.worsen(A, PERIOD) == [RouteChanged(FAR, B)]


def test_row_is_infeasible_after_better_advertisement(
    routing: RoutingTable,
) -> None:
    routing.on_rows(A, [(FAR, 7, 512)], 0)
    routing.on_rows(B, [(FAR, 7, 700)], 0)
    assert rows(routing)[FAR].metric == 768, "of which 700 would still be feasible"
    routing.on_rows(A, [(FAR, 7, 200)], PERIOD)
    assert rows(routing, 2 * SECOND)[FAR].metric == 456
    assert routing.drop_link(A, 2 * SECOND) == [RouteChanged(FAR, 0)], "B may lead back through us"
    assert routing.on_rows(B, [(FAR, 8, 700)], 2 * SECOND) == [RouteChanged(FAR, B)]
