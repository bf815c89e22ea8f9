"""Where neighbours are reached: targets of connections, and addresses that multicast does not reach."""

from collections.abc import Callable, Iterable
from typing import Final

from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.broker.core.swarm.neighbour import LinkPeer, Neighbour
from swarmd.broker.core.swarm.neighbours.neighbour_table import NeighbourTable
from swarmd.broker.core.swarm.node_table import NodeTable

CLAIMANTS_MAX: Final = 16
CLAIMANT_NS: Final = 3_000_000_000

Address = tuple[str, int]


class LinkTargets:
    """Addresses of the neighbours of one node."""

    def __init__(
        self,
        neighbours: NeighbourTable,
        nodes: NodeTable,
        host_of: Callable[[Neighbour], str] | None = None,
        curve_of: Callable[[str], bytes | None] | None = None,
    ) -> None:
        """`host_of`: address of a neighbour on the medium of its connections, or "" if that medium has none;
        None on a node with one network, where the source address of the beacons is the only one.

        `curve_of`: CURVE key of a platform on the roster, or None without a roster: hellos announce the keys.
        """
        self._host_of = host_of
        self._curve_of = curve_of
        self._neighbours = neighbours
        self._nodes = nodes
        self._claimants: dict[Address, int] = {}
        """Unicast senders without an accepted session, and until when beacons are sent to them."""

    def on_claimant(self, address: Address, now_ns: int) -> None:
        """Takes the address of a unicast datagram whose session is not accepted yet."""
        if len(self._claimants) < CLAIMANTS_MAX:
            self._claimants[address] = now_ns + CLAIMANT_NS

    def find(self, hw: int) -> LinkPeer | None:
        """Endpoint and keys of a neighbour, or None until it has announced a port.

        The same object is returned until something in it changes: connections and seals compare by identity.
        """
        neighbour = self._neighbours.get(hw)
        if neighbour is None or neighbour.hello is None or not neighbour.hello.tcp_port:
            return None
        hello, session = neighbour.hello, neighbour.session
        host = neighbour.address[0] if self._host_of is None else self._host_of(neighbour)
        peer = neighbour.peer
        if (
            peer is not None
            and neighbour.peer_hello is hello
            and peer.host == host
            and peer.session == session
        ):
            return peer
        platform = self._nodes.platform(hw)
        curve_public = hello.curve_public if self._curve_of is None else self._curve_of(platform)
        found = LinkPeer(hw, platform, host, hello.tcp_port, curve_public or b"", session, hello.frame_port)
        neighbour.peer_hello = hello
        if peer != found:  # most hellos repeat the former one
            neighbour.peer = found
        return neighbour.peer

    def on_roster(self) -> None:
        """Derives all endpoints again, because keys of platforms may have changed."""
        for neighbour in self._neighbours.all():
            neighbour.peer = None

    def unicast_addresses(self, seeds: Iterable[Address], now_ns: int) -> set[Address]:
        """Addresses of seeds, of neighbours and of claimants that multicast does not reach."""
        single: set[Address] = set()
        by_group: set[Address] = set()
        for neighbour in self._neighbours.all():
            if neighbour.state is not LinkState.DOWN:
                (single if neighbour.by_unicast else by_group).add(neighbour.address)
        # a seed that multicast reaches gets the beacon by the group
        single.update(address for address in seeds if address not in by_group)
        self._claimants = {address: end_ns for address, end_ns in self._claimants.items() if end_ns > now_ns}
        single.update(self._claimants)
        return single

    def platforms_at(self, host: str) -> set[str]:
        """Platforms of the neighbours at an address."""
        return {self._nodes.platform(one.hw) for one in self._neighbours.all() if one.address[0] == host}
