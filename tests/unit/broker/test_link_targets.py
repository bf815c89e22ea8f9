"""Targets of connections to neighbours, and the addresses that beacons reach by unicast."""

from tests.unit.broker.neighbours import AT, ME, SECOND, TIMEOUT, UAV2, UAV3, Peer, bring_up

from swarmd.broker.core.beacon.beacon import Header, Hello, PlatformCode
from swarmd.broker.core.swarm.neighbours.link_targets import CLAIMANT_NS, CLAIMANTS_MAX, LinkTargets
from swarmd.broker.core.swarm.neighbours.neighbour_table import NeighbourTable
from swarmd.broker.core.swarm.node_table import NodeTable
from swarmware.model.names import hardware_id

SEED = ("10.0.0.9", 7447)
CLAIMANT = ("10.0.0.7", 7447)


class Cell:
    """A node with one neighbour that is up."""

    def __init__(self) -> None:
        self.neighbours = NeighbourTable(ME, TIMEOUT)
        self.nodes = NodeTable(ME)
        self.targets = LinkTargets(self.neighbours, self.nodes)
        self.peer = Peer(self.neighbours)
        bring_up(self.neighbours, self.peer, SECOND)

    def announce(self, tcp_port: int = 9000) -> None:
        hello = Hello(1, 0, tcp_port, 1, 0, PlatformCode.UAV, "uav2", b"key", frame_port=9001)
        self.neighbours.on_hello(self.peer.neighbour, Header(0, UAV2, self.peer.sequence, 0), hello)


def test_a_neighbour_without_a_port_has_no_target() -> None:
    cell = Cell()
    cell.announce(tcp_port=0)
    assert cell.targets.find(UAV2) is None
    assert cell.targets.find(UAV3) is None


def test_target_is_replaced_when_neighbour_announces_another_port() -> None:
    cell = Cell()
    cell.announce()
    first = cell.targets.find(UAV2)
    assert first is not None
    assert (first.host, first.port, first.curve_public) == (AT[0], 9000, b"key")
    assert cell.targets.find(UAV2) is first, "unchanged"
    cell.announce()
    assert cell.targets.find(UAV2) is first, "repeated"
    cell.announce(tcp_port=9100)
    second = cell.targets.find(UAV2)
    assert second is not None and second.port == 9100
    cell.announce(tcp_port=0)
    assert cell.targets.find(UAV2) is None


def test_target_takes_host_of_chosen_medium() -> None:
    cell = Cell()
    cell.announce()
    targets = LinkTargets(cell.neighbours, cell.nodes, lambda neighbour: f"192.168.0.{neighbour.hw}")
    found = targets.find(UAV2)
    assert found is not None and found.host == f"192.168.0.{UAV2}"


def test_target_takes_key_of_present_roster() -> None:
    cell = Cell()
    cell.announce()
    roster = {cell.nodes.platform(UAV2): b"first"}
    targets = LinkTargets(cell.neighbours, cell.nodes, curve_of=roster.get)
    found = targets.find(UAV2)
    assert found is not None and found.curve_public == b"first"
    roster.clear()
    targets.on_roster()
    found = targets.find(UAV2)
    assert found is not None and not found.curve_public, "revoked"


def test_beacons_go_by_unicast_where_multicast_fails() -> None:
    cell = Cell()
    assert cell.targets.unicast_addresses([], SECOND) == set()
    assert cell.targets.unicast_addresses([AT, SEED], SECOND) == {SEED}, "the group reaches the neighbour"
    cell.peer.neighbour.by_unicast = True
    assert cell.targets.unicast_addresses([], SECOND) == {AT}
    cell.peer.neighbour.by_unicast = False
    assert cell.targets.unicast_addresses([], SECOND) == set()


def test_claimant_is_answered_by_unicast_for_three_seconds() -> None:
    cell = Cell()
    cell.targets.on_claimant(CLAIMANT, SECOND)
    assert cell.targets.unicast_addresses([], SECOND) == {CLAIMANT}
    assert cell.targets.unicast_addresses([], SECOND + CLAIMANT_NS) == set()


def test_claimants_beyond_the_limit_are_ignored() -> None:
    cell = Cell()
    for number in range(CLAIMANTS_MAX + 5):
        cell.targets.on_claimant(("10.0.1.1", number), SECOND)
    assert len(cell.targets.unicast_addresses([], SECOND)) == CLAIMANTS_MAX


def test_the_platforms_at_a_host_are_its_neighbours() -> None:
    cell = Cell()
    hw = hardware_id("uav7")
    cell.nodes.add("uav7", 0)
    peer = Peer(cell.neighbours, hw)
    bring_up(cell.neighbours, peer, SECOND)
    assert "uav7" in cell.targets.platforms_at(AT[0])
    assert cell.targets.platforms_at("10.9.9.9") == set()
