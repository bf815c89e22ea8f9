"""A member that relays invented poses of others, in moving and lossy swarms of whole brokers: nobody takes
one, and the member is named."""

from collections import Counter
from typing import Final

import msgspec
import pytest
from tests.simulation.directory.air import POSE, Air
from tests.simulation.directory.brokers import BrokerNode
from tests.simulation.seeds import seeds

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import BODY_LIMIT, OutgoingBeacon, RelayedValue
from swarmd.broker.core.beacon.parts.beacon_signature import PART_BYTES
from swarmd.broker.core.boards.board_action import ReportUnsignedValues
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmware.model.names import hardware_id
from swarmware.types.net import BoardSubscription
from swarmware.types.vehicle import Pose

INVENTED_Y_M: Final = 666.0
EACH: Final = 8
"""Invented values in a beacon."""


class AirWithForger(Air):
    """Swarm in which one member invents poses of the others and signs the beacons that relay them."""

    def __init__(self, seed: int, count: int, degree: float, speed_m_s: float) -> None:
        super().__init__(seed, count, degree, speed_m_s)
        self.forger = self.names[0]
        self.ahead_s = 0.0
        self.forges = False
        self.invented = 0
        self.believed: Counter[str] = Counter()
        """Invented poses that were taken, by receiver."""

    def start(self, name: str) -> None:
        super().start(name)
        if name == self.forger:
            core = self.brokers[name].core
            compose = core.compose
            core.compose = lambda now_ns: self.with_inventions(compose(now_ns))  # type: ignore[method-assign]  # a program with its keys can do that

    def with_inventions(self, outgoing: OutgoingBeacon) -> OutgoingBeacon:
        if not self.forges:
            return outgoing
        payload = Pose.planar(self.now_ns / 1e9, INVENTED_Y_M).pack()
        victims = self.random.sample(self.names[1:], EACH)
        inventions = tuple(
            RelayedValue(
                hardware_id(victim),
                POSE,
                round((self.now_ns / 1e9 + self.offset_s[victim] + self.ahead_s) * 1e6),
                0,
                2,
                True,
                payload,
            )
            for victim in victims
        )
        true = outgoing.beacon.relays
        # one has the proof of the true value
        stolen = tuple(msgspec.structs.replace(one, payload=payload) for one in true[:1])
        beacon = msgspec.structs.replace(outgoing.beacon, relays=(*stolen, *inventions))
        if len(codec.encode(beacon)) + PART_BYTES > BODY_LIMIT:
            return outgoing
        self.invented += len(beacon.relays)
        return msgspec.structs.replace(outgoing, beacon=beacon)

    def take_pose(self, node: BrokerNode, want: BoardSubscription, value: RemoteValue) -> None:
        if Pose.unpack(value.payload).y_m == INVENTED_Y_M:
            self.believed[node.name] += 1
        else:
            self.made_s[node.name, want.platform] = Pose.unpack(value.payload).x_m

    def accused(self) -> Counter[str]:
        """Names of the relays that nodes reported."""
        names = {hardware_id(name): name for name in self.names}
        return Counter(
            names[found.relay_hw]
            for node in self.brokers.values()
            for action in node.of(ReportUnsignedValues)
            if isinstance(action, ReportUnsignedValues)
            for found in action.found
        )


@pytest.mark.parametrize("seed", seeds(1, 10))
@pytest.mark.parametrize("ahead_s", [0.0, 60.0])
def test_invented_value_is_refused_and_member_is_named(seed: int, ahead_s: float) -> None:
    air = AirWithForger(seed, count=10, degree=5.0, speed_m_s=5.0)
    air.fly(4.0, look=False)
    assert not air.accused(), "nobody is accused without a reason"
    air.ahead_s, air.forges = ahead_s, True
    air.fly(6.0, look=False)
    assert air.invented > 100
    assert not air.believed
    assert set(air.accused()) == {air.forger}
