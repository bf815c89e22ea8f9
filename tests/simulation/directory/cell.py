"""Nodes in one cell, where all receive all: few whole brokers, and many light nodes that load them like such.

A whole node is a broker core with the daemon's driver; it takes every datagram that reaches it, and
subscribes to the poses of all. A light node has the daemon's schedule, and neighbours and sessions of the
whole nodes only. It sends signed beacons at the rate of a whole node, with its pose and as many echoes (those
to the whole nodes are real, the rest name other light nodes); in the air each is at least as long as the mean
one of a whole node. It sends a triggered one when one of its links changes. 2 % of the datagrams are lost,
delays are 1 to 20 ms, all start within a second. A beacon answers the sessions of 16 nodes, so a broker that
starts among 500 has all its links after two minutes.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from tests.simulation.directory.brokers import (
    OVERHEAD,
    SENDER_ADDRESS,
    BrokerNode,
    SimulatedKeys,
    beacon_of,
    header_of,
    signed_datagram,
)

from swarmd.broker.core.beacon.beacon import NO_ECHO, Beacon, BoardValue, Echo, Header, Hello, PlatformCode
from swarmd.broker.core.beacon.beacon_rate import BeaconSchedule, airtime_s
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.membership.sessions import Sessions
from swarmd.broker.core.membership.signatures.own_signatures import OwnSignatures
from swarmd.broker.core.swarm.links.link import LinkChanged
from swarmd.broker.core.swarm.neighbour import LISTING_NS
from swarmd.broker.core.swarm.neighbours.neighbour_table import LISTING_EACH_NS, NeighbourTable
from swarmware.model.names import data_id, hardware_id
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.net import BoardPublication, BoardSubscription, ConnectionStatus, LinkStatus, TreePlan

SECOND: Final = 1_000_000_000
LOSS: Final = 0.02
DELAY_S: Final = (0.001, 0.02)
POSE: Final = data_id("nav/pose", "Pose")
OFFERS: Final = (BoardPublication("nav/pose", POSE, "Pose"),)
LIGHT_SESSION: Final = 1
POSE_BYTES: Final = 25
FIRST_HZ: Final = 10.0
FIRST_BYTES: Final = 150.0


class SendBeacon(NamedTuple):
    """Action of a light node: compose the next beacon and send it."""


class LightCore:
    """A node that keeps only its links and sessions to the whole ones."""

    def __init__(self, cell: "Cell", index: int) -> None:
        self.cell = cell
        self.hw = hardware_id(f"uav{index}")
        self.name = f"uav{index}"
        self.schedule = BeaconSchedule(cell.now_ns + cell.random.randrange(SECOND), cell.random.random)
        self.table = NeighbourTable(self.hw, SECOND)
        self.sessions = Sessions(self.hw, LIGHT_SESSION, connections=False)
        self.signatures = OwnSignatures(self.hw, LIGHT_SESSION, SimulatedKeys(self.name))
        self.sequence = 1
        self.filler = index

    def deadline_ns(self) -> int:
        return self.schedule.due_ns

    def on_timer(self, now_ns: int) -> list[SendBeacon]:
        if self.table.advance(now_ns):
            self.trigger(now_ns)
        if now_ns < self.schedule.due_ns:
            return []
        self.schedule.on_sent(now_ns)
        return [SendBeacon()]

    def trigger(self, now_ns: int) -> None:
        self.schedule.trigger(now_ns, round(1e9 / self.cell.beacon_hz))

    def on_datagram(self, header: Header, beacon: Beacon, now_ns: int) -> list[SendBeacon]:
        assert header.session is not None
        links: list[LinkChanged] = []
        outcome = self.sessions.on_datagram(header.sender_hw, header.session, beacon.checks, now_ns)
        if outcome.accepted:
            neighbour = self.table.on_header(header, False, SENDER_ADDRESS, now_ns, links)
            assert neighbour is not None
            if beacon.hello is not None:
                self.table.on_hello(neighbour, header, beacon.hello)
            # a whole node tolerates more losses of each neighbour the more it has
            neighbour.expect(self.cell.count - 1, SECOND)
            self.table.on_echoes(neighbour, header, beacon.echoes, now_ns, links)
        if links or outcome.soon:
            self.trigger(now_ns)
        return []

    def compose(self, now_ns: int) -> tuple[Header, Beacon]:
        cell, self.sequence = self.cell, self.sequence + 1
        listing_ns = max(LISTING_NS, cell.count * LISTING_EACH_NS)
        echoes = self.table.echoes(now_ns, len(cell.whole), listing_ns)
        pose = BoardValue(POSE, 0, True, pose_made_at(now_ns))
        others = []
        for _ in range(math.ceil(cell.count / (listing_ns / 1e9 * cell.beacon_hz))):
            self.filler = (self.filler + 1) % len(cell.light)
            others.append(Echo(cell.light[self.filler].core.hw, 0, NO_ECHO, 255))
        period_ms = min(round(1000 / cell.beacon_hz), 0xFFFF)
        hello = Hello(1, 0, 1, 1, 0, PlatformCode.UAV, self.name, b"", period_ms, listing_ns // 1_000_000)
        beacon = Beacon(hello, echoes + tuple(others), values=(pose,), checks=self.sessions.due(now_ns))
        self.table.sent(self.sequence, now_ns)
        self.schedule.set_next(now_ns, round(1e9 / cell.beacon_hz))
        header = Header(0, self.hw, self.sequence, now_ns // 1000 & 0xFFFF_FFFF, LIGHT_SESSION)
        return header, beacon


class Light:
    """A light node on the air."""

    def __init__(self, cell: "Cell", index: int) -> None:
        self.cell = cell
        self.core = LightCore(cell, index)
        self.driver = cell.drive(self.core, self._send)
        cell.join(self.core.name, self._receive)
        self.driver.feed()

    def _send(self, _: SendBeacon) -> None:
        header, beacon = self.core.compose(self.cell.now_ns)
        data = signed_datagram(LIGHT_SESSION, header, beacon, self.core.signatures, self.cell.now_ns)
        self.cell.light_air_s += airtime_s(max(self.cell.beacon_bytes, len(data) + OVERHEAD))
        self.cell.multicast(self.core.name, data)

    def _receive(self, _sender: str, data: bytes) -> None:
        self.driver.feed(self.core.on_datagram(header_of(data), beacon_of(data), self.cell.now_ns))


class CellFigures(NamedTuple):
    """Figures of a cell."""

    air_ratio: float
    """Share of the air that all beacons take."""
    sent_hz: float
    """Beacons of a whole node."""
    links_ratio: float
    """Share of the links of the whole nodes that are up at the end."""
    changes_hz: float
    """Changes of links per whole node."""
    ages_s: list[float]
    """Ages of the poses of all others at the whole nodes, ten looks a second."""


class Cell(VirtualSwarm[str]):
    """Virtual time and the air."""

    def __init__(self, seed: int, count: int, whole: int) -> None:
        super().__init__(seed, loss=LOSS, delay_s=DELAY_S)
        self.count = count
        self.beacon_hz = FIRST_HZ
        """Rate of a whole node, which the light ones have, too."""
        self.beacon_bytes = FIRST_BYTES
        """Mean size of a whole node's last beacons, with all headers."""
        self.light_air_s = 0.0
        self.made_ns: dict[tuple[str, str], int] = {}
        """By receiver and origin: when the newest pose was made."""
        self.whole: list[BrokerNode] = []
        for index in range(whole):
            name = f"uav{index}"
            node = BrokerNode(
                self,
                name,
                VirtualClock(self),
                write_boards=self.write_pose,
                on_value=self.take_pose,
                signing=SimulatedKeys(name),
            )
            wants = tuple(
                BoardSubscription(f"uav{other}", "nav/pose", "Pose", POSE)
                for other in range(count)
                if other != index
            )
            node.driver.feed(node.core.on_plan(TreePlan(1, OFFERS, wants), 0))
            self.whole.append(node)
        self.light = [Light(self, index) for index in range(whole, count)]
        self.names = [node.name for node in self.whole]  # in order: each delivery takes a random number
        self.counted = (0, 0)
        self.every(1.0, self.look)

    def write_pose(self, node: BrokerNode, now_ns: int) -> None:
        if POSE in node.core.published.boards:
            node.core.published.boards[POSE].put(pose_made_at(now_ns), True, now_ns)  # it moves

    def take_pose(self, node: BrokerNode, want: BoardSubscription, value: RemoteValue) -> None:
        self.made_ns[node.name, want.platform] = int.from_bytes(value.payload, "little")

    def look(self) -> None:
        """Takes rate and size of the beacons of a whole node."""
        model = self.whole[0]
        self.beacon_hz = model.core.report.traffic(self.now_ns).tick_hz
        sent, size = self.counted
        if model.sent > sent:
            self.beacon_bytes = (model.sent_bytes - size) / (model.sent - sent)
            self.counted = (model.sent, model.sent_bytes)

    def multicast(self, sender: str, data: bytes) -> None:
        """Beacons of light nodes reach the whole ones only: the others would ignore them."""
        for receiver in self.nodes if sender in self.names else self.names:
            if receiver != sender:
                self.send(sender, receiver, data)

    def neighbours_up(self, node: BrokerNode) -> int:
        table = node.core.report.neighbours(lambda hw: ConnectionStatus.IDLE, self.now_ns).neighbours
        return sum(neighbour.state is LinkStatus.UP for neighbour in table)

    def measure(self, seconds: float) -> CellFigures:
        """The figures of the next seconds."""
        for node in self.whole:
            node.sent = node.sent_bytes = 0
            node.links.clear()
        self.light_air_s, self.counted = 0.0, (0, 0)
        ages_s: list[float] = []
        for _ in range(round(seconds * 10)):
            self.run_for(0.1)
            ages_s += [(self.now_ns - made_ns) / 1e9 for made_ns in self.made_ns.values()]
        whole_air_s = sum(node.sent * airtime_s(node.sent_bytes / node.sent) for node in self.whole)
        whole = len(self.whole)
        return CellFigures(
            (whole_air_s + self.light_air_s) / seconds,
            sum(node.sent for node in self.whole) / whole / seconds,
            float(np.mean([self.neighbours_up(node) for node in self.whole])) / (self.count - 1),
            sum(len(node.links) for node in self.whole) / whole / seconds,
            ages_s,
        )


def pose_made_at(now_ns: int) -> bytes:
    """Stands for a pose: it says when it was made."""
    return now_ns.to_bytes(POSE_BYTES, "little")
