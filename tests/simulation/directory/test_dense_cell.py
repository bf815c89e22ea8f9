"""Hundreds of nodes in one cell, where everybody hears everybody: the air is never full and links stay up.

Three nodes are whole: station, pace and codec as in the daemon, and they take every datagram that reaches
them. The others are light: each has the daemon's pace and a neighbour table of the three whole nodes only. It
ticks at the rate that a whole node has, sends datagrams of the same size (its echoes to the whole nodes are
real ones, the rest name other light nodes), and hurries when one of its three links changes, as a whole node
would. 2 % of the datagrams are lost, delays are 1 to 20 ms, all start within a second.
"""

import heapq
import random
from typing import Final

import pytest

from swarmd.broker.core import tick as codec
from swarmd.broker.core.mesh import LinkChanged, LinkEvent, Mesh
from swarmd.broker.core.neighbour import Neighbours
from swarmd.broker.core.pace import Pace, airtime_s
from swarmd.broker.core.station import Identity, Station
from swarmd.broker.core.tick import Echo, Header, Hello, PlatformKind, Tick
from swarmd.broker.core.traffic import IP_UDP_BYTES, Counters
from swarmware.names import data_id, hardware_id
from swarmware.types.net import Offer, TreePlan

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
        self.pace = Pace(cell.random.randrange(SECOND), cell.random.random)
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
        identity = Identity(self.hw, f"uav{index}", "main", PlatformKind.UAV, 1, b"")
        mesh = Mesh(self.hw, 1, SECOND, 0)
        self.station = Station(identity, mesh, Counters(), busy_hz=10.0, relay_bytes_s=3000.0)
        self.station.set_plan(TreePlan(1, (Offer("nav/pose", POSE, "Pose"),)))
        self.body_bytes = 0

    def step(self, now_ns: int) -> None:
        links, routes = self.station.on_timer(now_ns)
        self.note(links, lost=any(not route.via for route in routes))
        if now_ns >= self.pace.due_ns:
            self.station.bulletin.boards[POSE].put(now_ns.to_bytes(25, "little"), True, now_ns)  # it moves
            if self.pace.urgent or not self.station.is_idle(now_ns):
                self.pace.left(now_ns)
                self.send(now_ns)
            self.pace.next(now_ns, round(1e9 / self.station.tick_hz()))

    def send(self, now_ns: int) -> None:
        departure = self.station.compose(now_ns)
        body = codec.encode(departure.tick)
        assert len(body) <= codec.BODY_LIMIT
        self.body_bytes = len(body)
        self.station.sent(departure.sequence, now_ns, len(body) + OVERHEAD - IP_UDP_BYTES)
        self.count(len(body) + OVERHEAD)
        session = 1 if departure.with_session else None
        header = Header(0, self.hw, departure.sequence, now_ns // 1000 & 0xFFFF_FFFF, session)
        self.cell.spread(self, header, codec.decode(body), to_light=True)

    def receive(self, header: Header, tick: Tick, now_ns: int) -> None:
        arrival = self.station.on_datagram(header, tick, ("10.0.0.1", 1), now_ns)
        assert arrival is not None
        if arrival.stranger:
            self.station.say_hello()
        lost = any(not route.via for route in arrival.routes)
        self.note(arrival.links, lost=lost or arrival.stranger or bool(arrival.links))

    def note(self, links: list[LinkChanged], *, lost: bool) -> None:
        self.changes += len(links)
        if lost or any(change.event is LinkEvent.SILENT for change in links):
            self.cell.hurry(self, round(1e9 / self.station.allowed_hz()))


class Light(Node):
    """A node that keeps only its links to the whole ones."""

    def __init__(self, cell: "Cell", index: int) -> None:
        super().__init__(cell, index)
        self.table = Neighbours(self.hw, SECOND)
        self.sequence = 1
        self.filler = index

    def step(self, now_ns: int) -> None:
        if self.table.on_timer(now_ns):
            self.hurry()
        if now_ns >= self.pace.due_ns:
            self.pace.left(now_ns)
            self.send(now_ns)
            self.pace.next(now_ns, round(1e9 / self.cell.model.station.tick_hz()))

    def hurry(self) -> None:
        self.cell.hurry(self, round(1e9 / self.cell.model.station.allowed_hz()))

    def send(self, now_ns: int) -> None:
        model = self.cell.model
        self.sequence += 1
        listing_ns = model.station.mesh.neighbours.listing_ns()
        echoes = self.table.echoes(now_ns, 30, listing_ns)
        size = max(model.body_bytes, 100)
        others = []
        for _ in range(min((size - 100) // codec.ECHO_BYTES, 60)):
            self.filler = WHOLE + (self.filler + 1 - WHOLE) % (self.cell.count - WHOLE)
            others.append(Echo(self.cell.nodes[self.filler].hw, 0, codec.NO_ECHO, 255))
        period_ms = min(round(1000 / model.station.tick_hz()), 0xFFFF)
        name = f"uav{self.index}"
        hello = Hello(1, 0, 1, 1, 0, PlatformKind.UAV, name, b"", period_ms, listing_ns // 1_000_000)
        tick = codec.decode(codec.encode(Tick(hello, echoes + tuple(others))))
        self.table.sent(self.sequence, now_ns)
        self.count(size + OVERHEAD)
        header = Header(0, self.hw, self.sequence, now_ns // 1000 & 0xFFFF_FFFF, 1)
        self.cell.spread(self, header, tick, to_light=False)

    def receive(self, header: Header, tick: Tick, now_ns: int) -> None:
        links: list[LinkChanged] = []
        neighbour = self.table.on_header(header, False, ("10.0.0.1", 1), now_ns, links)
        assert neighbour is not None
        if tick.hello is not None:
            self.table.on_hello(neighbour, header, tick.hello)
        self.table.on_echoes(neighbour, header, tick.echoes, now_ns, links)
        if links:
            self.hurry()


class Cell:
    """Virtual time and the air."""

    def __init__(self, seed: int, count: int) -> None:
        self.random = random.Random(seed)
        self.count = count
        self.now_ns = 0
        self.order = 0
        self.events: list[tuple[int, int, int, Header | None, Tick | None]] = []
        self.whole = [Whole(self, index) for index in range(WHOLE)]
        self.model = self.whole[0]
        self.light = [Light(self, index) for index in range(WHOLE, count)]
        self.nodes: list[Whole | Light] = [*self.whole, *self.light]
        for node in self.nodes:
            self.wake(node)

    def push(self, at_ns: int, index: int, header: Header | None, tick: Tick | None) -> None:
        self.order += 1
        heapq.heappush(self.events, (at_ns, self.order, index, header, tick))

    def wake(self, node: Node) -> None:
        node.wake_ns = node.pace.due_ns
        self.push(node.wake_ns, node.index, None, None)

    def hurry(self, node: Node, gap_ns: int) -> None:
        if node.pace.hurry(self.now_ns, gap_ns):
            self.wake(node)

    def spread(self, sender: Node, header: Header, tick: Tick, *, to_light: bool) -> None:
        chance = self.random.random
        for node in self.nodes if to_light else self.whole:
            if node is not sender and chance() >= LOSS:
                self.push(self.now_ns + 1_000_000 + int(chance() * 19_000_000), node.index, header, tick)

    def run(self, seconds: float) -> None:
        until_ns = self.now_ns + int(seconds * SECOND)
        while self.events[0][0] <= until_ns:
            self.now_ns, _, index, header, tick = heapq.heappop(self.events)
            node = self.nodes[index]
            if header is not None and tick is not None:
                node.receive(header, tick, self.now_ns)
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
    assert air <= GOAL, "share of the air that all ticks take"
    for node in cell.whole:
        neighbours = node.station.mesh.neighbours
        assert len(neighbours.up()) >= 0.995 * (count - 1)
        assert node.changes / seconds <= 0.05, "link changes per second and node"
        assert node.sent / seconds <= 1.1 * node.station.tick_hz() + 0.1, "nothing drives the rate up"
