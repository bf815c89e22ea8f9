"""A member that seals beacons in the names of others, in moving and lossy swarms of whole brokers."""

from collections import Counter
from typing import Final

import pytest
from tests.simulation.directory.air import POSE, Air
from tests.simulation.directory.brokers import datagram, header_of
from tests.simulation.seeds import seeds

from swarmd.broker.core.beacon.beacon import Beacon, BoardValue, Header
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.membership.sessions import ReportImpersonation
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
        else:
            self.made_s[name, want.platform] = Pose.unpack(value.payload).x_m


@pytest.mark.parametrize("seed", seeds(1, 10))
def test_forger_is_refused_and_true_poses_arrive(seed: int) -> None:
    air = AirWithForger(seed)
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
