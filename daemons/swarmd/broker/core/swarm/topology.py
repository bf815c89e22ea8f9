"""Neighbour table and routing table together: the sections of a beacon about the topology, in and out."""

from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import (
    NEVER_NS,
    Beacon,
    Echo,
    Header,
    NeighbourRequest,
    RouteRow,
    SequenceRequest,
)
from swarmd.broker.core.beacon.beacon_codec import ECHO_BYTES, REQUEST_BYTES, ROW_BYTES
from swarmd.broker.core.beacon.request_parts import request_part_bytes
from swarmd.broker.core.swarm.clock_batches import ClockSample
from swarmd.broker.core.swarm.links.link import LinkChanged, LinkEvent, LinkState, rtt_penalty
from swarmd.broker.core.swarm.neighbour import Neighbour
from swarmd.broker.core.swarm.neighbours.neighbour_table import NeighbourTable
from swarmd.broker.core.swarm.routes.destination_routes import newer
from swarmd.broker.core.swarm.routes.routing_table import HYSTERESIS, REQUESTS_MAX, RouteChanged, RoutingTable

CHANGING_NS: Final = 5_000_000_000
"""Time after a link change in which the topology counts as changing: the swarm moves."""
NEW_NS: Final = 1_500_000_000
"""Time after its first datagram in which a restarted node names its session in every one."""
ROWS_MAX: Final = 60
"""Limit of rows in a beacon: 480 of its 1 238 bytes, the rest is for values."""
_JUMP_MAX: Final = 0x7FFF
JUMPS: Final = 4
"""Burst of raises of the own sequence number: each holder of a number of a former session may need one."""
JUMP_AGAIN_NS: Final = 60_000_000_000
"""Period of one further raise: 2³¹ numbers last for 45 days of continuous requests."""
JUMP_CEILING: Final = 0xF000_0000
"""Above this the number only counts datagrams: 310 days at 10 Hz until a new session must begin."""


class TopologyUpdate(msgspec.Struct, frozen=True, gc=False):
    """Changes by one beacon."""

    neighbour: Neighbour
    fresh: bool
    """No later beacon of the same sender has overtaken it."""
    clock_sample: ClockSample | None
    links: list[LinkChanged]
    routes: list[RouteChanged]
    is_asked: bool
    """The neighbour asks for a beacon."""


class TopologySection(msgspec.Struct, frozen=True, gc=False):
    """Sections of the next beacon about the topology."""

    echoes: tuple[Echo, ...]
    rows: tuple[RouteRow, ...]
    requests: tuple[SequenceRequest, ...]
    neighbour_requests: tuple[NeighbourRequest, ...]
    asked: tuple[int, ...]
    """Neighbours that are overdue."""


class Topology:
    """Neighbours and routes of one node."""

    def __init__(self, own_hw: int, first_sequence: int, link_timeout_ns: int, quiet_until_ns: int) -> None:
        """`quiet_until_ns`: instant from which routes over more than one hop are accepted.

        A restarted node has lost its feasibility distances, while others may still send through it:
        until they have taken the link to its former session down (`notice_ns`), a row it receives may
        be its own route returned.
        """
        self.own_hw = own_hw
        self._quiet_until_ns = quiet_until_ns
        self._new_until_ns = quiet_until_ns
        self.neighbours = NeighbourTable(own_hw, link_timeout_ns)
        self.routing = RoutingTable(own_hw)
        self._sequence = first_sequence
        self._jumps: list[int] = []
        """Instants of the last raises of the own sequence number."""
        self._composed_ns = NEVER_NS
        self._changed_ns = NEVER_NS

    def on_beacon(
        self, header: Header, beacon: Beacon, restarted: bool, address: tuple[str, int], rx_ns: int
    ) -> TopologyUpdate | None:
        """Takes an authenticated beacon. None: the neighbour table is full."""
        links: list[LinkChanged] = []
        neighbour = self.neighbours.on_header(header, restarted, address, rx_ns, links)
        if neighbour is None:
            return None
        routes: list[RouteChanged] = []
        if beacon.hello is not None:
            self.neighbours.on_hello(neighbour, header, beacon.hello)
        # rows of an overtaken beacon are older than the known ones
        fresh = neighbour.top == header.sequence
        solicitation = beacon.solicitation
        if solicitation is not None:
            neighbour.answer_ns = solicitation.answer_ms * 1_000_000
        clock_sample = self.neighbours.on_echoes(neighbour, header, beacon.echoes, rx_ns, links)
        routing = self.routing
        if links:
            self._note_changes(links, rx_ns)
            for change in links:
                # also of a neighbour that is up again by this very beacon; it has lost its feasibility
                # distances
                if change.before is LinkState.UP:
                    routes += routing.drop_link(header.sender_hw, rx_ns)
        if neighbour.state is LinkState.UP:
            routes += self._update_cost(neighbour, rx_ns)
            if fresh:
                # each beacon is an implicit row of its sender, at distance 0 and with its own number
                own = ((header.sender_hw, header.sequence & 0xFFFF, 0),)
                rows = own + beacon.rows if rx_ns >= self._quiet_until_ns else own
                routes += routing.on_rows(header.sender_hw, rows, rx_ns)
        if beacon.requests:
            routes += routing.on_requests(header.sender_hw, beacon.requests, rx_ns)
        if beacon.neighbour_requests and neighbour.state is LinkState.UP:
            routing.on_neighbour_requests(header.sender_hw, beacon.neighbour_requests, rx_ns)
        is_asked = solicitation is not None and self.own_hw in solicitation.asked
        return TopologyUpdate(neighbour, fresh, clock_sample, links, routes, is_asked)

    def advance(self, now_ns: int) -> tuple[list[LinkChanged], list[RouteChanged]]:
        """Handles deadlines of links and expiry of routes."""
        links = self.neighbours.advance(now_ns)
        routes: list[RouteChanged] = []
        self._note_changes(links, now_ns)
        for change in links:
            if change.before is LinkState.UP:
                routes += self.routing.drop_link(change.hw, now_ns)
        # overdue beacons raise the cost, so that routes turn before the link is down
        for neighbour in self.neighbours.up():
            if neighbour.missed:
                routes += self._update_cost(neighbour, now_ns)
        routes += self.routing.advance(now_ns)
        return links, routes

    def exclude(self, hw: int, now_ns: int) -> tuple[list[LinkChanged], list[RouteChanged]]:
        """Removes the link of a node that is not a member any more, and the routes over it and to it."""
        neighbour = self.neighbours.get(hw)
        if neighbour is not None and neighbour.state is not LinkState.DOWN:
            neighbour.deadline_ns = now_ns
        links, routes = self.advance(now_ns)
        return links, routes + self.routing.exclude(hw, now_ns)

    def _update_cost(self, neighbour: Neighbour, now_ns: int) -> list[RouteChanged]:
        """Sets the cost of a link in the routing table; compares routes when it rose by the hysteresis."""
        measured = (
            neighbour.window,
            neighbour.missed,
            neighbour.reported,
            neighbour.penalty + rtt_penalty(neighbour.rtt_ns),
        )
        # the cost is a division and a power; most beacons change nothing in it
        if measured == neighbour.cost_inputs:
            return []
        neighbour.cost_inputs = measured
        cost = neighbour.cost
        self.routing.set_link(neighbour.hw, cost)
        if cost < neighbour.compared_cost + HYSTERESIS:
            # a falling cost needs no comparison; the route over this link only becomes better
            neighbour.compared_cost = min(neighbour.compared_cost, cost)
            return []
        neighbour.compared_cost = cost
        return self.routing.worsen(neighbour.hw, now_ns)

    def _note_changes(self, links: list[LinkChanged], now_ns: int) -> None:
        if any(LinkState.UP in (change.before, change.after) for change in links):
            self._changed_ns = now_ns

    def is_new(self, now_ns: int) -> bool:
        """Whether each beacon names the session: links to the former one end by that."""
        return now_ns < self._new_until_ns

    def is_changing(self, now_ns: int, span_ns: int = CHANGING_NS) -> bool:
        """Whether a link came up or went down within `span_ns`."""
        return self._changed_ns != NEVER_NS and now_ns - self._changed_ns < span_ns

    def next_sequence(self) -> int:
        """Sequence number of the next beacon: the last one plus one, or above the number that others hold.

        After a start with a clock that was set back, others would reject our rows as old. Raises are
        limited: the numbers of a session are its nonces, and there are 2³² of them.
        """
        self._sequence += 1
        wanted = self.routing.requested_sequence
        if wanted is not None:
            self.routing.requested_sequence = None
            if newer(wanted, self._sequence & 0xFFFF) and self._may_jump():
                self._sequence += min((wanted - self._sequence & 0xFFFF) + 1, _JUMP_MAX)
        return self._sequence

    def _may_jump(self) -> bool:
        now_ns = self._composed_ns
        self._jumps = [at_ns for at_ns in self._jumps if now_ns - at_ns < JUMPS * JUMP_AGAIN_NS]
        if len(self._jumps) >= JUMPS or self._sequence > JUMP_CEILING:
            return False
        self._jumps.append(now_ns)
        return True

    def compose(self, now_ns: int, room: int) -> TopologySection:
        """Topology sections of the next beacon in at most `room` bytes."""
        if self._composed_ns == NEVER_NS:
            self._new_until_ns = min(self._new_until_ns, now_ns + NEW_NS)
        self._composed_ns = now_ns
        listing_ns = self.neighbours.listing_ns()
        echoes = self.neighbours.echoes(now_ns, min(room * 3 // 4 // ECHO_BYTES, 255), listing_ns)
        asked = self.neighbours.asked(now_ns)
        requests = self.routing.requests(now_ns)[:REQUESTS_MAX]
        neighbour_requests = self.routing.neighbour_requests()
        room -= (
            len(echoes) * ECHO_BYTES + len(requests) * REQUEST_BYTES + request_part_bytes(neighbour_requests)
        )
        linked = self.neighbours.linked(now_ns)
        rows = self.routing.rows(now_ns, max(0, min(ROWS_MAX, room // ROW_BYTES)), linked)
        return TopologySection(echoes, rows, requests, neighbour_requests, asked)

    def sent(self, sequence: int, tx_ns: int) -> None:
        """Records the send time of a beacon."""
        self.neighbours.sent(sequence, tx_ns)

    def deadline_ns(self) -> int | None:
        """Instant by which `advance` must be called, or None without a deadline."""
        return self.neighbours.deadline_ns()


__all__ = [
    "ClockSample",
    "LinkChanged",
    "LinkEvent",
    "LinkState",
    "RouteChanged",
    "Topology",
    "TopologySection",
    "TopologyUpdate",
]
