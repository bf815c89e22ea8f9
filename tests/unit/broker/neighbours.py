"""A neighbour table and the peers whose beacons it receives."""

from typing import Final

from swarmd.broker.core.beacon.beacon import Echo, Header, Hello, PlatformCode
from swarmd.broker.core.swarm.clock_batches import ClockSample
from swarmd.broker.core.swarm.links.link import LinkChanged, LinkState
from swarmd.broker.core.swarm.neighbour import (
    EXPECTED_MIN,
    Neighbour,
)
from swarmd.broker.core.swarm.neighbours.neighbour_table import (
    NeighbourTable,
)

ME, UAV2, UAV3 = 10, 20, 30


MS: Final = 1_000_000


SECOND: Final = 1000 * MS


TIMEOUT: Final = SECOND


AT: Final = ("10.0.0.2", 7447)


BOOT: Final = 77


class Peer:
    """The other end: makes headers as a broker with its own clock would."""

    def __init__(self, table: NeighbourTable, hw: int = UAV2, offset_us: int = 0) -> None:
        self.table = table
        self.hw = hw
        self.offset_us = offset_us
        self.sequence = 0
        self.period_ms = 100
        self.changes: list[LinkChanged] = []

    def datagram(
        self,
        now_ns: int,
        *echoes: Echo,
        restarted: bool = False,
        hello: bool = False,
        way_ns: int = 0,
        skip: int = 0,
    ) -> ClockSample | None:
        self.sequence += 1 + skip
        tx_us = (now_ns - way_ns) // 1000 + self.offset_us
        header = Header(0, self.hw, self.sequence, tx_us & 0xFFFF_FFFF)
        neighbour = self.table.on_header(header, restarted, AT, now_ns, self.changes)
        assert neighbour is not None
        if hello:
            said = Hello(BOOT, tx_us >> 32, 1, 0, 0, PlatformCode.UAV, "uav2", b"", self.period_ms, 2000)
            self.table.on_hello(neighbour, header, said)
        return self.table.on_echoes(neighbour, header, echoes, now_ns, self.changes)

    def is_(self, state: LinkState) -> bool:
        return self.neighbour.state is state

    @property
    def neighbour(self) -> Neighbour:
        found = self.table.get(self.hw)
        assert found is not None
        return found


def listed(table: NeighbourTable, now_ns: int, *, hold_ns: int = 50 * MS, quality: int = 255) -> Echo:
    """An echo to a datagram of ours that left before."""
    table.sent(now_ns // MS, now_ns - hold_ns - 2 * MS)
    return Echo(ME, now_ns // MS & 0xFF, hold_ns // 1000, quality)


def bring_up(table: NeighbourTable, peer: Peer, now_ns: int) -> None:
    for before in range(EXPECTED_MIN - 1, 0, -1):
        peer.datagram(now_ns - before * MS, hello=True)
    peer.datagram(now_ns, hello=True)
    peer.datagram(now_ns + 100 * MS, listed(table, now_ns + 100 * MS))
    assert peer.is_(LinkState.UP)
