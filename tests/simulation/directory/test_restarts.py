"""Brokers that start again in swarms of slow senders: no loop at any change of any route.

The world and the nodes are those of test_directory_swarm, with a sixth of the datagrams lost more. Every
second or so somebody's broker dies without a word and starts again 20 ms to 3 s later: it has forgotten
what it advertised, while others may still send through it. Slow senders are missed late: at 2 Hz (nobody
wants anything) after seconds, in a crowd, or where the processor is short, after more. Their new session is
believed as late as it can be.
"""

from pathlib import Path
from typing import Final

import pytest
from tests.simulation.directory.test_directory_swarm import SECOND, Node, Swarm

from swarmd.broker.core.beacon.beacon import Beacon, Header
from swarmd.broker.core.topology.link import LinkState
from swarmd.broker.core.topology.neighbour import notice_ns
from swarmd.broker.core.topology.topology import RouteChanged, Topology
from swarmd.broker.former_session import FormerSession

SEEDS: Final = 20
LOSS: Final = 1 / 6
AWAY_S: Final = (0.02, 0.2, 0.6, 1.5, 3.0)


class Restarting(Swarm):
    """A swarm whose routes are followed at each change."""

    def __init__(self, seed: int, nodes: int, period_ns: int) -> None:
        super().__init__(seed, nodes, period_ns, speed_m_s=3.0)
        self.changes = 0

    def look(self) -> None:
        super().look()
        for node in self.nodes:
            node.links = [(peer, delivery * (1 - LOSS)) for peer, delivery in node.links]

    def follow(self, node: Node, routes: list[RouteChanged]) -> None:
        super().follow(node, routes)
        for change in routes:
            self.changes += 1
            at, seen = node.hw, set[int]()
            while at and at != change.hw:
                assert at not in seen, (
                    f"loop at {self.now_ns / SECOND:.2f} s towards {change.hw}: {sorted(seen)}"
                )
                seen.add(at)
                at = int(self.next_hop[at, change.hw])

    def receive(self, node: Node, topology: Topology, header: Header, beacon: Beacon) -> None:
        """A new session is believed when the link to the old one has ended by silence."""
        known = node.sessions.get(header.sender_hw, header.session)
        neighbour = topology.neighbours.get(header.sender_hw)
        if known == header.session or neighbour is None or neighbour.state is LinkState.DOWN:
            super().receive(node, topology, header, beacon)

    def restart(self, quiet_ns: int) -> None:
        """Somebody dies; who was away for its time comes back."""
        for node in self.nodes:
            if node.topology is None and node.back_ns <= self.now_ns:
                self.start(node, self.now_ns, late=self.random.random() < 0.2, quiet_ns=quiet_ns)
        node = self.random.choice(self.nodes)
        if node.topology is not None:
            self.stop(node)
            node.back_ns = self.now_ns + int(self.random.choice(AWAY_S) * SECOND)


@pytest.mark.parametrize(("period_s", "every_s", "seconds"), [(0.1, 0.33, 4), (0.5, 0.5, 30), (2.0, 2.0, 60)])
def test_restarts_among_slow_senders_make_no_loop(period_s: float, every_s: float, seconds: int) -> None:
    period_ns, every_ns = round(period_s * SECOND), round(every_s * SECOND)
    for seed in range(SEEDS):
        swarm = Restarting(seed, 25, period_ns)
        try:
            for at_ns in range(every_ns, seconds * SECOND, every_ns):
                swarm.run(at_ns)
                swarm.move(every_s)
                swarm.restart(notice_ns(period_ns, SECOND))
        except AssertionError as error:
            pytest.fail(f"seed {seed}: {error}")
        assert swarm.changes > 500


def test_nodes_that_lost_their_data_make_no_loop_either(tmp_path: Path) -> None:
    quiet_ns = FormerSession(tmp_path).quiet_ns(SECOND)
    for seed in range(3):
        swarm = Restarting(seed, 25, SECOND // 2)
        try:
            for half_s in range(1, 60):
                swarm.run(half_s * SECOND // 2)
                swarm.move(0.5)
                swarm.restart(quiet_ns)
        except AssertionError as error:
            pytest.fail(f"seed {seed}: {error}")
        assert swarm.changes > 500
