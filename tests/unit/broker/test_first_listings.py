"""Echoes to new neighbours: one of them arrives soon, also over a link that loses beacons."""

from typing import Final

from swarmd.broker.core.beacon.beacon import Header
from swarmd.broker.core.swarm.links.link import LinkChanged
from swarmd.broker.core.swarm.neighbour import LISTING_NS
from swarmd.broker.core.swarm.neighbours.neighbour_table import FIRST_LISTINGS, NeighbourTable

SLOT_NS: Final = 100_000_000
PEERS: Final = range(20, 40)
ROOM: Final = 30


def test_new_neighbour_is_listed_six_times_in_period() -> None:
    table = NeighbourTable(10, 1_000_000_000)
    changes: list[LinkChanged] = []
    said: list[int] = []
    slots = LISTING_NS // SLOT_NS
    for slot in range(2 * slots):
        now_ns = slot * SLOT_NS
        for hw in PEERS:
            table.on_header(Header(0, hw, slot + 1, now_ns // 1000), False, ("10.0.0.2", 1), now_ns, changes)
        said += [echo.hw for echo in table.echoes(now_ns, ROOM, LISTING_NS)]
        if slot + 1 == slots:
            counts = [said.count(hw) for hw in PEERS]
            assert FIRST_LISTINGS <= min(counts) <= max(counts) <= FIRST_LISTINGS + 1
            said.clear()
    assert len(said) <= 2 * len(PEERS), "later it is listed in its turn"
