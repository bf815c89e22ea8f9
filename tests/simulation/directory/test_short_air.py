"""Twenty brokers in one cell whose values outgrow the channel: beacons slow down before a link goes down.

Cores and drivers as in the daemon, in virtual time; all receive all, and 2 % of the datagrams are lost. What
the beacons take of the air is computed from their bytes.
"""

from typing import Final

from tests.simulation.directory.brokers import BrokerNode

from swarmd.broker.core.beacon.beacon_rate import airtime_s
from swarmd.broker.core.swarm.links.link import LinkEvent, LinkState
from swarmware.model.names import data_id
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.net import BoardPublication, TreePlan

NODES: Final = 20
SMALL, LARGE = 25, 1000
"""Bytes of a value: with the large ones ten beacons a second of all would take a third of the channel."""
BOARD: Final = data_id("app/image", "Image")
PLAN: Final = TreePlan(1, (BoardPublication("app/image", BOARD, "Image"),))


class Channel(VirtualSwarm[str]):
    """Brokers in one cell."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed, loss=0.02, delay_s=(0.001, 0.02))
        self.size = SMALL
        self.brokers: list[BrokerNode] = []
        for index in range(NODES):
            node = BrokerNode(self, f"uav{index}", VirtualClock(self), write_boards=self.write)
            node.driver.feed(node.core.on_plan(PLAN, 0))
            self.brokers.append(node)

    def write(self, node: BrokerNode, now_ns: int) -> None:
        """Every beacon has a new value."""
        if BOARD in node.core.published.boards:
            node.core.published.boards[BOARD].put(now_ns.to_bytes(self.size, "little"), True, now_ns)

    def air_ratio(self, seconds: int) -> float:
        """Share of the channel that the beacons of the next seconds take."""
        for node in self.brokers:
            node.sent = node.sent_bytes = 0
        self.run_for(seconds)
        return sum(node.sent * airtime_s(node.sent_bytes / node.sent) for node in self.brokers) / seconds

    def rates_hz(self) -> list[float]:
        return [node.core.report.traffic(self.now_ns).tick_hz for node in self.brokers]

    def went_silent(self) -> int:
        """Links that went down because no datagram came."""
        return sum(change.event is LinkEvent.SILENT for node in self.brokers for change in node.links)


def test_brokers_short_of_channel_slow_and_keep_links() -> None:
    channel = Channel(1)
    channel.run_for(3)
    assert channel.rates_hz() == [10.0] * NODES
    channel.size = LARGE
    assert channel.air_ratio(1) < 0.35
    assert channel.air_ratio(2) <= 0.25
    assert max(channel.rates_hz()) < 8.0
    channel.size = SMALL
    channel.run_for(3)
    assert min(channel.rates_hz()) > 9.0
    assert not channel.went_silent()
    states = [state for node in channel.brokers for state in node.link_states.values()]
    assert states == [LinkState.UP] * (NODES * (NODES - 1))
