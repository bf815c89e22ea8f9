"""A swarm that stands still is quiet on the air, and the first motion is heard at once: navigators with noisy
sensors, stations and paces as in the daemons, datagrams encoded as on the wire, in virtual time."""

import heapq
import random
from typing import Final

import pytest

from swarmd.broker.core import beacon_codec as codec
from swarmd.broker.core.beacon import Header, PlatformKind
from swarmd.broker.core.beacon_protocol import BeaconProtocol, NodeIdentity
from swarmd.broker.core.beacon_rate import BeaconSchedule
from swarmd.broker.core.topology import LinkState, Topology
from swarmd.broker.core.traffic import Counters
from swarmd.navigator.config import Config
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.core.simulation import Simulation
from swarmware.geometry.world import Bounds, World
from swarmware.model.names import data_id, hardware_id
from swarmware.types.net import BoardPublication, BoardSubscription, TreePlan
from swarmware.types.vehicle import Goal, Pose

MS: Final = 1_000_000
SECOND: Final = 1000 * MS
POSE: Final = BoardPublication("nav/pose", data_id("nav/pose", "Pose"), "Pose", 50)
STATE: Final = BoardPublication(
    "mission/state", data_id("mission/state", "MissionState"), "MissionState", 100
)
BATTERY: Final = BoardPublication(
    "power/battery", data_id("power/battery", "BatteryState"), "BatteryState", 1000
)
WORLD: Final = World(description="", bounds=Bounds(x_m=(-100.0, 100.0), y_m=(-100.0, 100.0)))
LOSS: Final = 0.01


class Platform:
    """What of one platform has a say in how often it sends."""

    def __init__(self, index: int, names: list[str], chance: random.Random) -> None:
        self.name = names[index]
        self.hw = hardware_id(self.name)
        start = Pose.planar(4.0 * index, 0.0, 0.0, 0.3)
        self.simulation = Simulation(SimConfig(), WORLD, "uav", start, chance.gauss, chance.random)
        self.navigator = NavigatorCore(Config(), self.name, WORLD.origin, AirController(Config()))
        identity = NodeIdentity(self.hw, self.name, "main", PlatformKind.UAV, 1, b"")
        self.protocol = BeaconProtocol(
            identity, Topology(self.hw, 1, SECOND, 0), Counters(), busy_hz=10.0, relay_bytes_s=2200.0
        )
        wants = tuple(
            BoardSubscription(other, offer.path, offer.type, offer.data_id)
            for other in names
            if other != self.name
            for offer in (POSE, STATE, BATTERY)
        )
        self.protocol.set_plan(TreePlan(1, (POSE, STATE, BATTERY), wants))
        self.schedule = BeaconSchedule(chance.randrange(SECOND), chance.random)
        self.next_ns = chance.randrange(50 * MS)
        self.beat_ns = chance.randrange(SECOND)
        self.stated = b""
        self.sent = 0
        self.seen: dict[str, tuple[bytes, int]] = {}
        """The newest pose of each other platform, and since when it is known."""

    def live(self, now_ns: int) -> None:
        """Sensors, navigator and the boards that beat."""
        boards = self.protocol.published.boards
        sample = self.simulation.advance(now_ns)
        if sample is not None:
            if sample.imu is not None:
                self.navigator.on_imu(sample.imu, now_ns)
            if sample.gnss is not None:
                self.navigator.on_gnss(sample.gnss, now_ns)
            if sample.vehicle is not None:
                self.navigator.on_vehicle(sample.vehicle)
        step = self.navigator.step(now_ns)
        self.simulation.on_setpoint(step.setpoint, now_ns)
        if step.pose is not None:
            self.stated = step.pose.pack()
            boards[POSE.data_id].put(self.stated, True, now_ns)
        if now_ns >= self.beat_ns:
            self.beat_ns += SECOND
            boards[STATE.data_id].put(b"idle", False, now_ns)
            boards[BATTERY.data_id].put(b"%d" % now_ns, False, now_ns)


class Swarm:
    """Everybody hears everybody."""

    def __init__(self, count: int, seed: int) -> None:
        self.chance = random.Random(seed)
        names = [f"uav{index + 1}" for index in range(count)]
        self.platforms = [Platform(index, names, self.chance) for index in range(count)]
        self.now_ns = 0
        self.air: list[tuple[int, int, int, Header, bytes]] = []
        self.order = 0

    def run(self, seconds: float) -> None:
        until_ns = self.now_ns + round(seconds * SECOND)
        while self.now_ns < until_ns:
            self.now_ns += 5 * MS
            for index, platform in enumerate(self.platforms):
                if self.now_ns >= platform.next_ns:
                    platform.next_ns += 50 * MS
                    platform.live(self.now_ns)
                platform.protocol.advance(self.now_ns)
                if self.now_ns >= platform.schedule.due_ns:
                    self.beacon(index, platform)
            while self.air and self.air[0][0] <= self.now_ns:
                rx_ns, _, index, header, body = heapq.heappop(self.air)
                self.deliver(self.platforms[index], header, body, rx_ns)

    def beacon(self, index: int, sender: Platform) -> None:
        protocol = sender.protocol
        if sender.schedule.urgent or not protocol.may_skip(self.now_ns):
            sender.schedule.on_sent(self.now_ns)
            outgoing = protocol.compose(self.now_ns)
            body = codec.encode(outgoing.beacon)
            protocol.sent(outgoing.sequence, self.now_ns, len(body) + 38)
            sender.sent += 1
            session = 1 if outgoing.with_session else None
            header = Header(0, sender.hw, outgoing.sequence, self.now_ns // 1000 & 0xFFFF_FFFF, session)
            for other in range(len(self.platforms)):
                if other != index and self.chance.random() >= LOSS:
                    self.order += 1
                    delay_ns = self.chance.randrange(1, 5) * MS
                    heapq.heappush(self.air, (self.now_ns + delay_ns, self.order, other, header, body))
        sender.schedule.set_next(self.now_ns, round(1e9 / protocol.beacon_hz()))

    def deliver(self, receiver: Platform, header: Header, body: bytes, rx_ns: int) -> None:
        received = receiver.protocol.on_beacon(header, codec.decode(body), ("h", 1), rx_ns)
        assert received is not None
        if received.first_hello or received.links:
            receiver.protocol.schedule_hello()
            receiver.schedule.trigger(rx_ns, 100 * MS)
        for want, value in received.values:
            if want.data_id == POSE.data_id:
                receiver.seen[want.platform] = value.payload, rx_ns


@pytest.mark.parametrize(("count", "seed"), [(3, 1), (6, 2)])
def test_a_swarm_that_stands_still_is_quiet_and_its_first_motion_is_heard_at_once(
    count: int, seed: int
) -> None:
    swarm = Swarm(count, seed)
    swarm.run(18.0)
    for platform in swarm.platforms:
        platform.sent = 0
    swarm.run(20.0)
    for platform in swarm.platforms:
        assert 1.5 < platform.sent / 20.0 <= 2.5, "datagrams per second"
        assert all(n.state is LinkState.UP for n in platform.protocol.topology.neighbours.all())
        ages_s = [(swarm.now_ns - since_ns) / 1e9 for _, since_ns in platform.seen.values()]
        assert len(ages_s) == count - 1
        assert max(ages_s) < 1.2, "the mirrors are confirmed, one lost datagram allowed"

    mover, witness = swarm.platforms[0], swarm.platforms[1]
    mover.simulation.on_arm(True)
    mover.navigator.on_goal(Goal(1, "takeoff", z_m=5.0), swarm.now_ns)
    parked = mover.stated
    while mover.stated == parked:
        swarm.run(0.005)
    begin_ns = swarm.now_ns
    while witness.seen[mover.name][0] == parked:
        swarm.run(0.005)
        assert swarm.now_ns - begin_ns < 0.2 * SECOND, "the first motion is heard"
    mover.sent = witness.sent = 0
    swarm.run(2.0)
    assert mover.sent >= 18
    assert witness.sent <= 6, "who stands still stays quiet beside one that moves"
