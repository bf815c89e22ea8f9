"""What neighbours receive themselves: nodes that all of them receive, and values that they need relayed."""

import pytest
from tests.unit.broker.neighbours import ME, MS, SECOND, TIMEOUT, UAV2, UAV3, Peer, bring_up, listed

from swarmd.broker.core.beacon.beacon import NO_ECHO, Echo
from swarmd.broker.core.swarm.neighbours.neighbour_table import WELL, NeighbourTable


@pytest.fixture
def table() -> NeighbourTable:
    return NeighbourTable(ME, TIMEOUT)


@pytest.fixture
def peer(table: NeighbourTable) -> Peer:
    return Peer(table)


def test_common_are_those_that_every_neighbour_hears(table: NeighbourTable) -> None:
    one, other = Peer(table, UAV2), Peer(table, UAV3)
    for peer, hears in ((one, (UAV3, 50, 60)), (other, (UAV2, 50))):
        bring_up(table, peer, 0)
        peer.datagram(200 * MS, *(Echo(hw, 1, 5, 255) for hw in hears))
    assert table.common(200 * MS) == {UAV2, UAV3, 50}


def test_partially_connected_node_is_common_not_linked(table: NeighbourTable) -> None:
    """One neighbour hears it and is not heard: it needs our row."""
    one, other, third = Peer(table, UAV2), Peer(table, UAV3), Peer(table, 40)
    for peer, hears in ((one, (UAV3, 40, 50)), (other, (UAV2, 40, 50)), (third, (UAV3, UAV2, 50))):
        bring_up(table, peer, 0)
        peer.datagram(200 * MS, *(Echo(hw, 1, 5, 255) for hw in hears))
    assert table.linked(200 * MS) == {UAV2, UAV3, 40}, "of 50 it is not known"
    one.datagram(300 * MS, Echo(40, 0, NO_ECHO, 0))
    assert table.common(2 * SECOND) == {UAV2, UAV3, 50}
    third.datagram(2 * SECOND, listed(table, 2 * SECOND))
    one.datagram(2 * SECOND, Echo(40, 1, 5, 255), listed(table, 2 * SECOND))
    third.datagram(2 * SECOND + MS, Echo(UAV2, 0, NO_ECHO, 0))
    assert table.common(4 * SECOND) == {UAV2, UAV3, 40, 50} - {UAV2}
    assert table.linked(4 * SECOND) == {UAV3}


def test_old_reception_of_neighbour_expires(table: NeighbourTable, peer: Peer) -> None:
    bring_up(table, peer, 0)
    peer.datagram(200 * MS, Echo(50, 1, 5, 255))
    peer.datagram(8 * SECOND, listed(table, 8 * SECOND))
    assert table.common(8 * SECOND) == {UAV2}
    assert table.needed(50, set(), 8 * SECOND)
    assert not table.needed(50, {UAV2}, 8 * SECOND)


def test_neighbour_does_not_need_well_received_value(table: NeighbourTable, peer: Peer) -> None:
    bring_up(table, peer, 0)
    peer.datagram(200 * MS, Echo(UAV3, 1, 5, WELL), Echo(40, 1, 5, WELL - 1))
    assert not table.needed(50, {UAV3}, 200 * MS), "it receives uav3, which has sent the value"
    assert table.needed(50, {40}, 200 * MS), "what 40 sends is often lost"
    peer.datagram(300 * MS, Echo(UAV3, 1, 5, WELL - 1))
    assert table.needed(50, {UAV3}, 300 * MS)


def triple(table: NeighbourTable, one_hears_other: int, other_hears_one: int) -> tuple[Peer, Peer]:
    """Two neighbours that hear each other with these qualities, and this node with all."""
    one, other = Peer(table, UAV2), Peer(table, UAV3)
    for peer in (one, other):
        bring_up(table, peer, 0)
    one.datagram(200 * MS, Echo(UAV3, 1, 5, one_hears_other))
    other.datagram(200 * MS, Echo(UAV2, 1, 5, other_hears_one))
    return one, other


@pytest.mark.parametrize(
    ("one_hears_other", "other_hears_one", "linked"),
    [
        (255, 255, {UAV2, UAV3}),
        (WELL - 1, WELL - 1, {UAV2, UAV3}),  # 1 040: less than twice the 512 over this node, and 256
        (153, 153, set()),  # 60 % each way: 1 975
        (102, 255, set()),  # 40 % one way: 1 600
        (102, 102, set()),
    ],
)
def test_rows_are_needed_where_own_way_is_better(
    table: NeighbourTable, one_hears_other: int, other_hears_one: int, linked: set[int]
) -> None:
    triple(table, one_hears_other, other_hears_one)
    assert table.common(200 * MS) == {UAV2, UAV3}
    assert table.linked(200 * MS) == linked


def test_rows_are_unneeded_after_link_has_recovered(
    table: NeighbourTable,
) -> None:
    one, other = triple(table, 102, 102)
    assert table.linked(200 * MS) == set()
    one.datagram(2 * SECOND, Echo(UAV3, 1, 5, 255), listed(table, 2 * SECOND))
    other.datagram(2 * SECOND, Echo(UAV2, 1, 5, 255), listed(table, 2 * SECOND))
    assert table.linked(2 * SECOND) == {UAV2, UAV3}


def test_equally_bad_own_way_needs_no_rows(table: NeighbourTable) -> None:
    one, other = triple(table, 153, 153)
    for number in range(1, 20):  # of both every second datagram arrives
        for peer in (one, other):
            peer.datagram((200 + 100 * number) * MS, listed(table, (200 + 100 * number) * MS), skip=1)
    assert [neighbour.cost > 3 * 256 for neighbour in table.up()] == [True, True]
    assert table.linked(2200 * MS) == {UAV2, UAV3}
