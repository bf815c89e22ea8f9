"""Addresses and ports of a lab whose nodes reach each other over the relay on loopback.

Every node has an address of its own, and knows each other node by an address of the relay that stands for
exactly that node as seen by exactly this one; so the relay sees from the addresses who sends to whom.
"""

import resource
from typing import Final

import msgspec

from swarmware.errors import InvalidInput

RELAY: Final = "relay"
"""Network of a lab (`--net`) with sockets on loopback."""
_NODES: Final = "127.83.0"
"""Start of the addresses of nodes."""
_OTHERS: Final = "127.84"
"""Start of the addresses of the relay."""
DESCRIPTORS_PER_LINK: Final = 7
"""Of each direction: two sockets for datagrams and one that listens; two connections with two ends each."""
DESCRIPTORS_SPARE: Final = 64
NODES_MAX: Final = 250
"""The last byte of an address is that of a node."""


class RelayPlan(msgspec.Struct, frozen=True):
    """Addresses and ports of one lab."""

    group: str
    """Multicast group of the lab; each node has one of its own, which differs in the last byte."""
    port: int
    """Port of the groups, and from which nodes send their beacons."""

    @property
    def urgent_port(self) -> int:
        """Port of the nodes for connections and for frames in datagrams."""
        return self.port + 1

    def group_of(self, node: int) -> str:
        """Multicast group to which this node sends, and in which only the relay receives it."""
        return f"{self.group.rpartition('.')[0]}.{node + 1}"

    def node(self, node: int) -> str:
        """Address of a node."""
        return f"{_NODES}.{node + 1}"

    def seen(self, node: int, at: int) -> str:
        """Address by which the node `at` knows this one."""
        return f"{_OTHERS}.{at + 1}.{node + 1}"


def reserve_descriptors(nodes: int) -> None:
    """Raises this process's limit of open files to what a relay of that many nodes needs.

    Raises: InvalidInput when there are too many nodes, or the limit cannot be as high.
    """
    if nodes > NODES_MAX:
        raise InvalidInput(f"--net relay: {nodes} nodes; expected {NODES_MAX} at most")
    needed = DESCRIPTORS_PER_LINK * nodes * (nodes - 1) + DESCRIPTORS_SPARE
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or needed <= soft:
        return
    if hard != resource.RLIM_INFINITY and needed > hard:
        raise InvalidInput(
            f"--net relay: {nodes} nodes need {needed} open files, the limit of this user is {hard};"
            " expected fewer nodes, or a higher limit (ulimit -Hn)"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
