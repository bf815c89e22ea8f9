"""Where neighbours are reached: targets of connections, and addresses that multicast does not reach."""

from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import Hello
from swarmd.broker.core.swarm.neighbours.link import LinkState
from swarmd.broker.core.swarm.neighbours.neighbour_table import NeighbourTable
from swarmd.broker.core.swarm.node_table import NodeTable

CLAIMANTS_MAX: Final = 16
CLAIMANT_NS: Final = 3_000_000_000

Address = tuple[str, int]


class LinkTarget(msgspec.Struct, frozen=True):
    """Target of a connection to a neighbour."""

    platform: str
    host: str
    tcp_port: int
    curve_public: bytes
    """The key that it announced itself; empty where the key is on the roster."""
    session: int
    frame_port: int = 0
    """UDP port for frames as datagrams; 0: none."""


class LinkTargets:
    """Addresses of the neighbours of one node."""

    def __init__(
        self,
        neighbours: NeighbourTable,
        nodes: NodeTable,
        host_of: Callable[[int], str] | None = None,
    ) -> None:
        """`host_of`: of a neighbour where there are several media, empty where none of them has connections;
        None: its beacons have the only address."""
        self._host_of = host_of
        self._neighbours = neighbours
        self._nodes = nodes
        self.by_unicast: set[int] = set()
        """Neighbours whose newest datagram came by unicast."""
        self._targets: dict[int, tuple[Hello, Address, LinkTarget]] = {}
        """Of neighbours that frames went to, with the hello and address that they follow from."""
        self._claimants: dict[Address, int] = {}
        """Unicast senders without an accepted session, and until when beacons are sent to them."""

    def on_neighbour(self, hw: int, by_multicast: bool) -> None:
        """Takes how the newest datagram of a neighbour came."""
        if by_multicast:
            self.by_unicast.discard(hw)
        else:
            self.by_unicast.add(hw)

    def on_claimant(self, address: Address, now_ns: int) -> None:
        """Takes the address of a unicast datagram whose session is not accepted yet."""
        if len(self._claimants) < CLAIMANTS_MAX:
            self._claimants[address] = now_ns + CLAIMANT_NS

    def find(self, hw: int) -> LinkTarget | None:
        """Target of a connection to a neighbour; None: it has not announced a port."""
        neighbour = self._neighbours.get(hw)
        if neighbour is None or neighbour.hello is None or not neighbour.hello.tcp_port:
            self._targets.pop(hw, None)
            return None
        hello, address, session = neighbour.hello, neighbour.address, neighbour.session
        if self._host_of is not None:
            address = (self._host_of(hw), 0)
        known = self._targets.get(hw)
        if known is not None and known[0] is hello and known[1] == address and known[2].session == session:
            return known[2]
        target = LinkTarget(
            self._nodes.platform(hw),
            address[0],
            hello.tcp_port,
            hello.curve_public,
            session,
            hello.frame_port,
        )
        self._targets[hw] = hello, address, target
        return target

    def unicast_addresses(self, seeds: Iterable[Address], now_ns: int) -> set[Address]:
        """Addresses of seeds, of neighbours and of claimants that multicast does not reach."""
        if not seeds and not self.by_unicast and not self._claimants:
            return set()
        single: set[Address] = set()
        by_group: set[Address] = set()
        for neighbour in self._neighbours.all():
            if neighbour.state is not LinkState.DOWN:
                (single if neighbour.hw in self.by_unicast else by_group).add(neighbour.address)
        single.update(address for address in seeds if address not in by_group)
        self._claimants = {address: end_ns for address, end_ns in self._claimants.items() if end_ns > now_ns}
        single.update(self._claimants)
        return single

    def platforms_at(self, host: str) -> set[str]:
        """Platforms of the neighbours at an address."""
        return {self._nodes.platform(one.hw) for one in self._neighbours.all() if one.address[0] == host}
