"""Hundreds of nodes in one cell, where everybody hears everybody: the air is never full and links stay up.

Three nodes are whole: protocol, schedule and codec as in the daemon, and they take every datagram that
reaches them. The others are light: each has the daemon's schedule and a neighbour table of the three whole
nodes only. It sends beacons of the same size at the rate of a whole node (its echoes to the whole nodes are
real, the rest name other light nodes), and a triggered one when one of its three links changes, as a whole
node would. 2 % of the datagrams are lost, delays are 1 to 20 ms, all start within a second.
"""

import heapq
import random
from typing import Final

import pytest

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import BODY_LIMIT, NO_ECHO, Beacon, Echo, Header, Hello, PlatformCode
from swarmd.broker.core.beacon.beacon_rate import BeaconSchedule, airtime_s
from swarmd.broker.core.beacon_protocol import BeaconProtocol, NodeIdentity
from swarmd.broker.core.topology.neighbour import NeighbourTable
from swarmd.broker.core.topology.topology import LinkChanged, LinkEvent, Topology
from swarmd.broker.core.traffic import IP_UDP_BYTES, Counters
from swarmware.model.names import data_id, hardware_id
from swarmware.types.net import BoardPublication, TreePlan

SECOND: Final = 1_000_000_000
WHOLE: Final = 3
LOSS: Final = 0.02
OVERHEAD: Final = codec.HEADER_BYTES + 16 + IP_UDP_BYTES
POSE: Final = data_id("nav/pose", "Pose")
GOAL: Final = 0.25
"""Share of the air."""


class Node:
    """What whole and light nodes share."""

    def __init__(self, cell: "Cell", index: int) -> None:
        self.cell = cell
        self.index = index
        self.hw = hardware_id(f"uav{index}")
        self.schedule = BeaconSchedule(cell.random.randrange(SECOND), cell.random.random)
        self.sent = 0
        self.air_s = 0.0
        self.changes = 0
        self.wake_ns = -1

    def count(self, size: int) -> None:
        self.sent += 1
        self.air_s += airtime_s(size)


class Whole(Node):
    """A node as the daemon has it."""

    def __init__(self, cell: "Cell", index: int) -> None:
        super().__init__(cell, index)
        identity = NodeIdentity(self.hw, f"uav{index}", "main", PlatformCode.UAV, 1, b"")
        topology = Topology(self.hw, 1, SECOND, 0)
        self.protocol = BeaconProtocol(identity, topology, Counters(), busy_hz=10.0, relay_bytes_s=3000.0)
        self.protocol.set_plan(TreePlan(1, (BoardPublication("nav/pose", POSE, "Pose"),)))
        self.body_bytes = 0

    def step(self, now_ns: int) -> None:
        links, routes = self.protocol.advance(now_ns)
        self.note(links, lost=any(not route.via for route in routes))
        if now_ns >= self.schedule.due_ns:
            self.protocol.published.boards[POSE].put(now_ns.to_bytes(25, "little"), True, now_ns)  # it moves
            if self.schedule.urgent or not self.protocol.may_skip(now_ns):
                self.schedule.on_sent(now_ns)
                self.send(now_ns)
            self.schedule.set_next(now_ns, round(1e9 / self.protocol.beacon_hz()))

    def send(self, now_ns: int) -> None:
        outgoing = self.protocol.compose(now_ns)
        body = codec.encode(outgoing.beacon)
        assert len(body) <= BODY_LIMIT
        self.body_bytes = len(body)
        self.protocol.sent(outgoing.sequence, now_ns, len(body) + OVERHEAD - IP_UDP_BYTES)
        self.count(len(body) + OVERHEAD)
        session = 1 if outgoing.with_session else None
        header = Header(0, self.hw, outgoing.sequence, now_ns // 1000 & 0xFFFF_FFFF, session)
        self.cell.spread(self, header, codec.decode(body), to_light=True)

    def receive(self, header: Header, beacon: Beacon, now_ns: int) -> None:
        received = self.protocol.on_beacon(header, beacon, ("10.0.0.1", 1), now_ns)
        assert received is not None
        if received.first_hello:
            self.protocol.schedule_hello()
        lost = any(not route.via for route in received.routes)
        self.note(received.links, lost=lost or received.first_hello or bool(received.links))

    def note(self, links: list[LinkChanged], *, lost: bool) -> None:
        self.changes += len(links)
        if lost or any(change.event is LinkEvent.SILENT for change in links):
            self.cell.trigger(self, round(1e9 / self.protocol.allowed_hz()))


class Light(Node):
    """A node that keeps only its links to the whole ones."""

    def __init__(self, cell: "Cell", index: int) -> None:
        super().__init__(cell, index)
        self.table = NeighbourTable(self.hw, SECOND)
        self.sequence = 1
        self.filler = index

    def step(self, now_ns: int) -> None:
        if self.table.advance(now_ns):
            self.trigger()
        if now_ns >= self.schedule.due_ns:
            self.schedule.on_sent(now_ns)
            self.send(now_ns)
            self.schedule.set_next(now_ns, round(1e9 / self.cell.model.protocol.beacon_hz()))

    def trigger(self) -> None:
        self.cell.trigger(self, round(1e9 / self.cell.model.protocol.allowed_hz()))

    def send(self, now_ns: int) -> None:
        model = self.cell.model
        self.sequence += 1
        listing_ns = model.protocol.topology.neighbours.listing_ns()
        echoes = self.table.echoes(now_ns, 30, listing_ns)
        size = max(model.body_bytes, 100)
        others = []
        for _ in range(min((size - 100) // codec.ECHO_BYTES, 60)):
            self.filler = WHOLE + (self.filler + 1 - WHOLE) % (self.cell.count - WHOLE)
            others.append(Echo(self.cell.nodes[self.filler].hw, 0, NO_ECHO, 255))
        period_ms = min(round(1000 / model.protocol.beacon_hz()), 0xFFFF)
        name = f"uav{self.index}"
        hello = Hello(1, 0, 1, 1, 0, PlatformCode.UAV, name, b"", period_ms, listing_ns // 1_000_000)
        beacon = codec.decode(codec.encode(Beacon(hello, echoes + tuple(others))))
        self.table.sent(self.sequence, now_ns)
        self.count(size + OVERHEAD)
        header = Header(0, self.hw, self.sequence, now_ns // 1000 & 0xFFFF_FFFF, 1)
        self.cell.spread(self, header, beacon, to_light=False)

    def receive(self, header: Header, beacon: Beacon, now_ns: int) -> None:
        links: list[LinkChanged] = []
        neighbour = self.table.on_header(header, False, ("10.0.0.1", 1), now_ns, links)
        assert neighbour is not None
        if beacon.hello is not None:
            self.table.on_hello(neighbour, header, beacon.hello)
        self.table.on_echoes(neighbour, header, beacon.echoes, now_ns, links)
        if links:
            self.trigger()


class Cell:
    """Virtual time and the air."""

    def __init__(self, seed: int, count: int) -> None:
        self.random = random.Random(seed)
        self.count = count
        self.now_ns = 0
        self.order = 0
        self.events: list[tuple[int, int, int, Header | None, Beacon | None]] = []
        self.whole = [Whole(self, index) for index in range(WHOLE)]
        self.model = self.whole[0]
        self.light = [Light(self, index) for index in range(WHOLE, count)]
        self.nodes: list[Whole | Light] = [*self.whole, *self.light]
        for node in self.nodes:
            self.wake(node)

    def push(self, at_ns: int, index: int, header: Header | None, beacon: Beacon | None) -> None:
        self.order += 1
        heapq.heappush(self.events, (at_ns, self.order, index, header, beacon))

    def wake(self, node: Node) -> None:
        node.wake_ns = node.schedule.due_ns
        self.push(node.wake_ns, node.index, None, None)

    def trigger(self, node: Node, gap_ns: int) -> None:
        if node.schedule.trigger(self.now_ns, gap_ns):
            self.wake(node)

    def spread(self, sender: Node, header: Header, beacon: Beacon, *, to_light: bool) -> None:
        chance = self.random.random
        for node in self.nodes if to_light else self.whole:
            if node is not sender and chance() >= LOSS:
                self.push(self.now_ns + 1_000_000 + int(chance() * 19_000_000), node.index, header, beacon)

    def run(self, seconds: float) -> None:
        until_ns = self.now_ns + int(seconds * SECOND)
        while self.events[0][0] <= until_ns:
            self.now_ns, _, index, header, beacon = heapq.heappop(self.events)
            node = self.nodes[index]
            if header is not None and beacon is not None:
                node.receive(header, beacon, self.now_ns)
            elif self.now_ns == node.wake_ns:
                node.step(self.now_ns)
                self.wake(node)
        self.now_ns = until_ns


@pytest.mark.parametrize(
    ("count", "settle_s", "seconds"), [(200, 15.0, 15.0), (300, 20.0, 20.0), (500, 30.0, 30.0)]
)
def test_hundreds_of_nodes_in_one_cell_leave_air_and_keep_their_links(
    count: int, settle_s: float, seconds: float
) -> None:
    cell = Cell(1, count)
    cell.run(settle_s)
    for node in cell.nodes:
        node.sent = node.changes = 0
        node.air_s = 0.0
    cell.run(seconds)
    air = sum(node.air_s for node in cell.nodes) / seconds
    assert air <= GOAL, "share of the air that all beacons take"
    for node in cell.whole:
        neighbours = node.protocol.topology.neighbours
        assert len(neighbours.up()) >= 0.995 * (count - 1)
        assert node.changes / seconds <= 0.05, "link changes per second and node"
        assert node.sent / seconds <= 1.1 * node.protocol.beacon_hz() + 0.1, "nothing drives the rate up"
