"""Ten brokers on one processor that cannot carry them at their rate: they slow down, and no link falls.

Stations and paces as in the daemon, in virtual time. All share one processor, which does one thing after the
other: each timer that is due and each datagram that came costs it time, so timers are late when it is behind.
A socket keeps 256 datagrams and drops what comes then.
"""

import heapq
import random
from collections import Counter
from typing import Final

import pytest

from swarmd.broker.core import beacon_codec as codec
from swarmd.broker.core.beacon import Beacon, Header, PlatformKind
from swarmd.broker.core.beacon_protocol import BeaconProtocol, NodeIdentity
from swarmd.broker.core.beacon_rate import BeaconSchedule, Slowdown
from swarmd.broker.core.link import LinkEvent
from swarmd.broker.core.topology import Topology
from swarmd.broker.core.traffic import Counters
from swarmware.model.names import data_id, hardware_id
from swarmware.types.net import BoardPublication, TreePlan

SECOND: Final = 1_000_000_000
MS: Final = SECOND // 1000
NODES: Final = 10
BUFFER: Final = 256
BEACON_MS: Final = 2.0
AMPLE_MS: Final = 0.1
"""What a datagram costs."""
SHORT_MS: Final = 23.0
"""At 10 Hz the ten would take 21 processors, and one needs 2.1 s for a round of beacons."""
POSE: Final = data_id("nav/pose", "Pose")


class Node:
    """A broker."""

    def __init__(self, index: int, chance: random.Random) -> None:
        name = f"uav{index}"
        self.index = index
        self.hw = hardware_id(name)
        identity = NodeIdentity(self.hw, name, "main", PlatformKind.UAV, 1, b"")
        topology = Topology(self.hw, 1, SECOND, 0)
        self.protocol = BeaconProtocol(identity, topology, Counters(), busy_hz=10.0, relay_bytes_s=2200.0)
        self.protocol.set_plan(TreePlan(1, (BoardPublication("nav/pose", POSE, "Pose"),)))
        self.schedule = BeaconSchedule(chance.randrange(SECOND // 10), chance.random)
        self.inbox = 0
        self.wake_ns = 0


class Processor:
    """What is due, in the order in which it became due, and the time at which the processor gets to it."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.now_ns = 0
        self.receive_ms = AMPLE_MS
        self.nodes = [Node(index, self.random) for index in range(NODES)]
        self.events: list[tuple[int, int, int, Header | None, Beacon | None]] = []
        self.order = 0
        self.fallen: Counter[str] = Counter()
        for node in self.nodes:
            self.wake(node)

    def push(self, at_ns: int, index: int, header: Header | None, beacon: Beacon | None) -> None:
        self.order += 1
        heapq.heappush(self.events, (at_ns, self.order, index, header, beacon))

    def wake(self, node: Node) -> None:
        deadline_ns = node.protocol.deadline_ns()
        node.wake_ns = node.schedule.due_ns if deadline_ns is None else min(node.schedule.due_ns, deadline_ns)
        self.push(node.wake_ns, node.index, None, None)

    def run(self, seconds: float) -> None:
        until_ns = self.now_ns + int(seconds * SECOND)
        while self.events and self.now_ns < until_ns:
            due_ns, _, index, header, beacon = heapq.heappop(self.events)
            self.now_ns = max(self.now_ns, due_ns)
            node = self.nodes[index]
            if header is not None and beacon is not None:
                node.inbox -= 1
                self.now_ns += round(self.receive_ms * MS)
                node.protocol.on_beacon(header, beacon, ("10.0.0.1", 1), self.now_ns)
                continue
            if due_ns == node.wake_ns:
                self.step(node)
                self.wake(node)

    def step(self, node: Node) -> None:
        """As `Broker._step`."""
        now_ns = self.now_ns
        links, _ = node.protocol.advance(now_ns)
        self.fallen.update(link.event.name for link in links)
        if now_ns < node.schedule.due_ns:
            return
        protocol = node.protocol
        protocol.slowdown.on_beacon(now_ns - node.schedule.due_ns, round(1e9 / protocol.beacon_hz()))
        protocol.published.boards[POSE].put(bytes(23), True, now_ns)
        node.schedule.on_sent(now_ns)
        self.send(node)
        node.schedule.set_next(now_ns, round(1e9 / protocol.beacon_hz()))

    def send(self, node: Node) -> None:
        self.now_ns += round(BEACON_MS * MS)
        outgoing = node.protocol.compose(self.now_ns)
        body = codec.encode(outgoing.beacon)
        session = 1 if outgoing.with_session else None
        header = Header(0, node.hw, outgoing.sequence, self.now_ns // 1000 & 0xFFFF_FFFF, session)
        node.protocol.sent(outgoing.sequence, self.now_ns, len(body) + 30)
        for other in self.nodes:
            if other is not node and other.inbox < BUFFER:
                other.inbox += 1
                self.push(self.now_ns + MS, other.index, header, codec.decode(body))

    def shorten(self, seconds: int) -> None:
        """Less and less is left for the brokers."""
        for second in range(1, seconds + 1):
            self.receive_ms = AMPLE_MS + (SHORT_MS - AMPLE_MS) * (second / seconds) ** 2
            self.run(1)

    def links_up(self) -> int:
        return sum(len(node.protocol.topology.neighbours.up()) for node in self.nodes)


def test_brokers_whose_processor_is_short_slow_down_keep_their_links_and_come_back() -> None:
    processor = Processor(0)
    processor.run(5)
    processor.shorten(30)
    processor.run(10)
    assert not processor.fallen[LinkEvent.SILENT.name]
    assert processor.links_up() == NODES * (NODES - 1)
    rates = [node.protocol.beacon_hz() for node in processor.nodes]
    assert max(rates) < 10.0
    assert min(rates) >= 1.0
    assert sum(node.protocol.slowdown.delayed_beacons for node in processor.nodes) > 50
    processor.receive_ms = AMPLE_MS
    processor.run(45)
    assert [node.protocol.beacon_hz() for node in processor.nodes] == [10.0] * NODES
    assert not processor.fallen[LinkEvent.SILENT.name]


def test_the_same_brokers_lose_their_links_without_slowing_down(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Slowdown, "on_beacon", lambda *_: False)
    processor = Processor(0)
    processor.run(5)
    processor.shorten(30)
    processor.run(20)
    assert processor.fallen[LinkEvent.SILENT.name] > 10
