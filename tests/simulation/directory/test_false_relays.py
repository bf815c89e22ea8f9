"""A member that relays invented poses of another one, in moving and lossy swarms of whole brokers.

The member states them with the stamps that hide the true ones for longest. A node that receives the origin
takes none, and the member is named. A node that does not receive the origin has true values again soon after
the last invented one.
"""

from collections import Counter
from typing import Final

import msgspec
import pytest
from tests.simulation.directory.air import POSE, Air
from tests.simulation.directory.brokers import BrokerNode, beacon_of, datagram, header_of
from tests.simulation.seeds import seeds

from swarmd.broker.core.action import ReportContradictions
from swarmd.broker.core.beacon.beacon import RelayedValue
from swarmd.broker.core.boards.relay_cache import OLDEST_NS, RemoteValue
from swarmd.broker.core.received_values import DIRECT_PERIODS
from swarmware.model.names import hardware_id
from swarmware.types.net import BoardSubscription, ConnectionStatus, LinkStatus
from swarmware.types.vehicle import Pose

INVENTED_Y_M: Final = 666.0


class AirWithForger(Air):
    """Swarm in which one member adds invented poses of the others to its beacons."""

    signs = False  # the inventions are put in after signing

    def __init__(self, seed: int, count: int, degree: float, speed_m_s: float) -> None:
        super().__init__(seed, count, degree, speed_m_s)
        self.forger = self.names[0]
        self.victims = self.names[1:]
        self.ahead_s = 0.0
        self.forges = False
        self.believed: Counter[tuple[str, str]] = Counter()
        """Invented poses that were taken, by receiver and origin."""
        self.invented: dict[tuple[str, str], bool] = {}
        """Whether the newest pose is an invented one, by receiver and origin."""
        self.silent_periods: list[float] = []
        """Periods since the last beacon of the origin, which is in range, when an invented pose was taken."""

    def multicast(self, sender: str, data: bytes) -> None:
        if self.forges and sender == self.forger:
            data = self.with_inventions(data)
        super().multicast(sender, data)

    def with_inventions(self, data: bytes) -> bytes:
        node = self.brokers[self.forger]
        relays = tuple(
            RelayedValue(
                hardware_id(victim),
                POSE,
                round((self.now_ns / 1e9 + self.offset_s[victim] + self.ahead_s) * 1e6),
                0,
                2,
                True,
                Pose.planar(self.now_ns / 1e9, INVENTED_Y_M).pack(),
            )
            for victim in self.random.sample(self.victims, min(8, len(self.victims)))
        )
        beacon = msgspec.structs.replace(beacon_of(data), relays=relays)
        return datagram(node.core.session, header_of(data), beacon)

    def take_pose(self, node: BrokerNode, want: BoardSubscription, value: RemoteValue) -> None:
        key = node.name, want.platform
        is_invented = Pose.unpack(value.payload).y_m == INVENTED_Y_M
        self.invented[key] = is_invented
        if not is_invented:
            self.made_s[key] = Pose.unpack(value.payload).x_m
            return
        self.believed[key] += 1
        table = node.core.report.neighbours(lambda _: ConnectionStatus.IDLE, node.clock.now_ns())
        for one in table.neighbours:
            if one.platform == want.platform and one.state is not LinkStatus.DOWN and one.boot_id:
                self.silent_periods.append(one.silent_s * one.tick_hz)

    def accused(self) -> Counter[str]:
        """Names of the relays that nodes reported."""
        names = {hardware_id(name): name for name in self.names}
        return Counter(
            names[found.relay_hw]
            for node in self.brokers.values()
            for action in node.of(ReportContradictions)
            if isinstance(action, ReportContradictions)
            for found in action.found
        )


@pytest.mark.parametrize("seed", seeds(1, 10))
@pytest.mark.parametrize("ahead_s", [0.0, 0.9, 60.0])
def test_who_receives_the_origin_takes_no_invented_value_and_names_the_member(
    seed: int, ahead_s: float
) -> None:
    air = AirWithForger(seed, count=10, degree=5.0, speed_m_s=5.0)
    air.fly(34.0, look=False)
    assert not air.accused(), "nobody is accused without a reason"
    air.ahead_s, air.forges = ahead_s, True
    air.fly(10.0, look=False)
    assert air.accused()[air.forger] > 0
    assert all(silent > DIRECT_PERIODS - 0.01 for silent in air.silent_periods)
    air.forges = False
    air.fly(OLDEST_NS / 1e9 + 4.0, look=False)
    left = [key for key, is_invented in air.invented.items() if is_invented and air.forger not in key]
    hops = air.distances()
    index = {name: number for number, name in enumerate(air.names)}
    assert not [key for key in left if hops[index[key[0]]][index[key[1]]]]
