"""Sixteen nodes of one cell start within one second, in virtual time."""

from typing import Final

from tests.simulation.directory.brokers import BrokerNode

from swarmd.broker.core.topology.link import LinkState
from swarmware.testing.virtual import VirtualClock, VirtualSwarm

NODES: Final = 16
WITHIN_S: Final = 1.0
STEP_S: Final = 0.05
LONGEST_S: Final = 30.0


def storm(seed: int, loss: float) -> tuple[VirtualSwarm[str], list[BrokerNode]]:
    """The cell before its first node has started, and the list of those that have."""
    cell = VirtualSwarm[str](seed, loss=loss, delay_s=(0.001, 0.02))
    nodes: list[BrokerNode] = []
    for number in range(1, NODES + 1):

        def start(name: str = f"uav{number}") -> None:
            nodes.append(BrokerNode(cell, name, VirtualClock(cell), session=1 + cell.now_ns))

        cell.at(round(cell.random.uniform(0, WITHIN_S) * 1e9), start)
    return cell, nodes


def converged_s(seed: int, loss: float) -> float:
    """Time from the first start until each node has a route to each other one."""
    cell, nodes = storm(seed, loss)
    while cell.now_ns < LONGEST_S * 1e9:
        cell.run_for(STEP_S)
        if len(nodes) == NODES and all(len(node.core.report.routes().routes) == NODES - 1 for node in nodes):
            break
    return cell.now_ns / 1e9


def falls(seed: int, loss: float, *, before_s: float, lasts_s: float) -> int:
    """How many links went down in a time after the start, although all nodes stayed."""
    cell, nodes = storm(seed, loss)
    cell.run_for(before_s)
    for node in nodes:
        node.links.clear()
    cell.run_for(lasts_s)
    return sum(change.before is LinkState.UP for node in nodes for change in node.links)
