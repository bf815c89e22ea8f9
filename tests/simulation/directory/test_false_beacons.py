"""A member that seals beacons in the names of others, in moving and lossy swarms of whole brokers."""

from collections import Counter
from typing import Final

import pytest
from tests.simulation.directory.air import POSE, Air
from tests.simulation.directory.brokers import datagram, header_of
from tests.simulation.seeds import seeds

from swarmd.broker.core.action import ReportImpersonation
from swarmd.broker.core.beacon.beacon import Beacon, BoardValue, Header
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmware.types.net import BoardSubscription
from swarmware.types.vehicle import Pose

INVENTED_Y_M: Final = 666.0
VICTIM: Final = 1
"""Index of the platform in whose name the first one forges."""


class AirWithForger(Air):
    """Swarm in which one member sends a beacon in the name of another one after each of its own."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed, count=8, degree=9.0, speed_m_s=5.0)
        self.forger, self.victim = self.names[0], self.names[VICTIM]
        self.forges = False
        self.sequence = 0
        """Of the newest beacon of the victim."""
        self.forged = 0
        self.believed: Counter[str] = Counter()
        """Invented poses that were taken, by receiver."""
        self.last_s: dict[str, float] = {}
        """Instant of the last one."""

    def multicast(self, sender: str, data: bytes) -> None:
        super().multicast(sender, data)
        if sender == self.victim:
            self.sequence = header_of(data).sequence
        if self.forges and sender == self.forger:
            self.forged += 1
            node = self.brokers[self.victim]
            header = Header(0, node.hw, self.sequence + 1, node.clock.now_ns() // 1000 & 0xFFFF_FFFF, None)
            pose = Pose.planar(self.now_ns / 1e9, INVENTED_Y_M).pack()
            beacon = Beacon(values=(BoardValue(POSE, 0, True, pose),))
            super().multicast(sender, datagram(node.core.session, header, beacon))

    def take_pose(self, node: object, want: BoardSubscription, value: RemoteValue) -> None:
        name = getattr(node, "name", "")
        if Pose.unpack(value.payload).y_m == INVENTED_Y_M:
            self.believed[name] += 1
            self.last_s[name] = self.now_ns / 1e9
        else:
            self.made_s[name, want.platform] = Pose.unpack(value.payload).x_m


class SignedAirWithForger(AirWithForger):
    """The same swarm, where every beacon is signed."""

    signs_all = True


@pytest.mark.parametrize("seed", seeds(1, 10))
def test_after_seconds_nobody_believes_the_forger_and_the_true_poses_arrive(seed: int) -> None:
    air = AirWithForger(seed)
    air.fly(12.0, look=False)
    assert not any(node.of(ReportImpersonation) for node in air.brokers.values()), "none without a reason"
    air.forges, began_s = True, air.now_ns / 1e9
    air.fly(20.0, look=False)
    assert air.forged > 150
    # in range of the victim one or two until its next beacon, and those again as relayed values; 14 s are the
    # trust in a node that has left the range
    assert all(last_s < began_s + 15.0 for last_s in air.last_s.values())
    assert not air.believed or max(air.believed.values()) <= 20
    assert bool(air.believed) <= any(node.of(ReportImpersonation) for node in air.brokers.values())
    index = air.names.index(air.victim)
    for name, hops in zip(air.names, air.distances()[index], strict=True):
        if hops == 1 and name != air.forger:
            assert air.now_ns / 1e9 - air.made_s[name, air.victim] < 1.0, "the true one is believed"


@pytest.mark.parametrize("seed", seeds(1, 10))
def test_where_every_beacon_is_signed_nobody_ever_believes_the_forger(seed: int) -> None:
    air = SignedAirWithForger(seed)
    air.fly(4.0, look=False)
    assert not any(node.of(ReportImpersonation) for node in air.brokers.values()), "none without a reason"
    near = air.distances() == 1
    air.victim = air.names[max(range(1, len(air.names)), key=lambda one: (near[0] & near[one]).sum())]
    air.forges = True
    air.fly(6.0, look=False)
    assert air.forged > 50
    assert not air.believed
    assert any(node.of(ReportImpersonation) for node in air.brokers.values())
    index = air.names.index(air.victim)
    for name, hops in zip(air.names, air.distances()[index], strict=True):
        if hops == 1 and name != air.forger:
            assert air.now_ns / 1e9 - air.made_s[name, air.victim] < 1.0, "the true one is believed"
