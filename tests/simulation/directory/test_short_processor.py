"""Ten brokers on one processor that cannot carry them at their rate: they slow down, and no link goes down.

Cores and drivers as in the daemon, in virtual time. All share one processor, which does one thing after the
other: each timer that is due and each datagram that came costs it time, so timers are late when it is behind.
A socket keeps 256 datagrams and drops those that follow.
"""

import heapq
from collections import Counter
from typing import Final

import pytest
from tests.simulation.directory.brokers import BrokerNode

from swarmd.broker.config import Config
from swarmd.broker.core.beacon.beacon_rate import Slowdown
from swarmd.broker.core.frames.reliable.reliable_links import ReliableLinks
from swarmd.broker.core.swarm.links.link import LinkEvent
from swarmware.model.names import data_id
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.net import BoardPublication, ConnectionStatus, TreePlan

SECOND: Final = 1_000_000_000
MS: Final = SECOND // 1000
NODES: Final = 10
BUFFER: Final = 256
BEACON_MS: Final = 2.0
AMPLE_MS: Final = 0.1
"""What a datagram costs."""
SHORT_MS: Final = 23.0
"""At 10 Hz the ten would take 21 processors, and one needs 2.1 s for a round of beacons."""
LATE_MS: Final = 5.0
"""The ten keep their links, but many beacons are late: the start of a lab."""
POSE: Final = data_id("nav/pose", "Pose")


class Processor(VirtualSwarm[str]):
    """What is due, in the order in which it became due, and the time at which the processor gets to it."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed, delay_s=(0.001, 0.001))
        self.receive_ms = AMPLE_MS
        self.waiting: Counter[str] = Counter()
        self.dropped = 0
        self.brokers = []
        for index in range(NODES):
            self.now_ns = self.random.randrange(SECOND // 10)
            node = BrokerNode(self, f"uav{index}", VirtualClock(self), write_boards=self.write_boards)
            node.driver.feed(node.core.on_plan(TreePlan(1, (BoardPublication("nav/pose", POSE, "Pose"),)), 0))
            self.brokers.append(node)

    def write_boards(self, node: BrokerNode, now_ns: int) -> None:
        self.now_ns += round(BEACON_MS * MS)
        node.core.published.boards[POSE].put(now_ns.to_bytes(23, "little"), True, now_ns)

    def run_until(self, end_ns: int) -> None:
        while self._events and self.now_ns < end_ns:
            due_ns, _, event = heapq.heappop(self._events)
            self.now_ns = max(self.now_ns, due_ns)
            event()

    def _carry(self, sender: str, receiver: str, data: bytes) -> None:
        if self.waiting[receiver] < BUFFER:
            self.waiting[receiver] += 1
            super()._carry(sender, receiver, data)
        else:
            self.dropped += 1

    def _arrive(self, sender: str, receiver: str, data: bytes) -> None:
        self.waiting[receiver] -= 1
        self.now_ns += round(self.receive_ms * MS)
        super()._arrive(sender, receiver, data)

    def shorten(self, seconds: int) -> None:
        """Less and less is left for the brokers."""
        for second in range(1, seconds + 1):
            self.receive_ms = AMPLE_MS + (SHORT_MS - AMPLE_MS) * (second / seconds) ** 2
            self.run_for(1)

    def silent(self) -> int:
        """Links that went down because no datagram came."""
        return sum(change.event is LinkEvent.SILENT for node in self.brokers for change in node.links)

    def links_up(self) -> int:
        return sum(
            neighbour.state == "up"
            for node in self.brokers
            for neighbour in node.core.report.neighbours(
                lambda hw: ConnectionStatus.IDLE, self.now_ns
            ).neighbours
        )

    def rates_hz(self) -> list[float]:
        return [node.core.report.traffic(self.now_ns).tick_hz for node in self.brokers]


def test_brokers_short_of_processor_slow_and_keep_links() -> None:
    processor = Processor(0)
    processor.run_for(5)
    processor.shorten(30)
    processor.run_for(10)
    assert not processor.silent()
    assert processor.links_up() == NODES * (NODES - 1)
    rates = processor.rates_hz()
    assert max(rates) < 10.0
    assert min(rates) >= 1.0
    assert sum(node.core.report.traffic(processor.now_ns).slowed_ticks for node in processor.brokers) > 50
    processor.receive_ms = AMPLE_MS
    processor.run_for(45)
    assert processor.rates_hz() == [10.0] * NODES
    assert not processor.silent()


def test_same_brokers_lose_their_links_without_slowing_down(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Slowdown, "on_beacon", lambda *_: False)
    processor = Processor(0)
    processor.run_for(5)
    processor.shorten(30)
    processor.run_for(20)
    assert processor.silent() > 10


def test_late_beacons_without_loss_keep_frames_on_connections() -> None:
    processor = Processor(0)
    processor.receive_ms = LATE_MS
    carriers = {node.name: ReliableLinks(Config()) for node in processor.brokers}
    overdue = 0
    for _ in range(20):
        processor.run_for(1)
        for node in processor.brokers:
            now_ns = node.clock.now_ns()
            for hw, quality in node.core.report.link_qualities(now_ns):
                overdue += quality.silence > 0
                carriers[node.name].on_quality(hw, quality, now_ns)
    others = [
        (one, hw) for one in carriers for hw in (node.hw for node in processor.brokers if node.name != one)
    ]
    assert not processor.dropped
    assert processor.links_up() == NODES * (NODES - 1)
    assert overdue > 20, "the processor was not short"
    assert not [one for one, hw in others if carriers[one].uses_datagrams(hw)]
