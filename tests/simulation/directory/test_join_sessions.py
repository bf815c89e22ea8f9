"""What it costs in bytes that a node and 15 others accept each other: questions, answers, signatures."""

from collections import Counter
from typing import Final

from tests.simulation.directory.brokers import BrokerNode, SimulatedKeys, beacon_of

from swarmd.broker.core.beacon import session_checks
from swarmd.broker.core.beacon.beacon_signature import PART_BYTES
from swarmd.broker.core.topology.link import LinkState
from swarmware.testing.virtual import VirtualClock, VirtualSwarm

OTHERS: Final = 15
NEW: Final = "uav16"
WINDOW_S: Final = 10.0
PERIOD_S: Final = 5.0
"""Of signatures without any reason."""


class Cell(VirtualSwarm[str]):
    """Nodes at rest that all receive each other, and what their beacons had of sessions."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed, delay_s=(0.001, 0.02))
        self.counts: Counter[str] = Counter()

    def start(self, name: str) -> BrokerNode:
        return BrokerNode(self, name, VirtualClock(self), signing=SimulatedKeys(name))

    def multicast(self, sender: str, data: bytes) -> None:
        beacon = beacon_of(data)
        self.counts["signatures"] += beacon.signature is not None
        self.counts["checks"] += session_checks.body_bytes(len(beacon.checks))
        super().multicast(sender, data)

    def count(self, seconds: float) -> Counter[str]:
        """What was sent in this time."""
        self.counts = Counter()
        self.run_for(seconds)
        return self.counts


def test_a_node_that_joins_fifteen_others_costs_a_kilobyte_of_sessions_and_is_linked_at_once() -> None:
    cell = Cell(seed=3)
    for number in range(OTHERS):
        cell.start(f"uav{number + 1}")
    cell.run_for(20.0)
    before = cell.count(WINDOW_S)
    assert before["checks"] == 0, "nodes at rest ask nothing"
    node = cell.start(NEW)
    joining = cell.count(0.5)
    up = [state for state in node.link_states.values() if state is LinkState.UP]
    assert len(up) == OTHERS
    joining += cell.count(WINDOW_S - 0.5)
    more = joining["signatures"] - before["signatures"] - round(WINDOW_S / PERIOD_S)
    print(f"{joining['checks']} B of questions and answers, {more} signatures of {PART_BYTES} B more")
    assert joining["checks"] <= 500
    assert joining["checks"] + more * PART_BYTES <= 1_000
