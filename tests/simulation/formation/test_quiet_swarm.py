"""A swarm that stands still is quiet on the air, and the first motion is heard at once: navigators with noisy
sensors, stations and paces as in the daemons, datagrams encoded as on the wire, in virtual time."""

import heapq
import random
from typing import Final

import pytest

from swarmd.broker.core import tick as codec
from swarmd.broker.core.mesh import LinkState, Mesh
from swarmd.broker.core.pace import Pace
from swarmd.broker.core.station import Identity, Station
from swarmd.broker.core.tick import Header, PlatformKind
from swarmd.broker.core.traffic import Counters
from swarmd.navigator.config import Config
from swarmd.navigator.core.air_pilot import AirPilot
from swarmd.navigator.core.navigator import Navigator
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.core.simulation import Simulation
from swarmware.names import data_id, hardware_id
from swarmware.types.net import Offer, TreePlan, Want
from swarmware.types.vehicle import Goal, Pose
from swarmware.world import Bounds, World

MS: Final = 1_000_000
SECOND: Final = 1000 * MS
POSE: Final = Offer("nav/pose", data_id("nav/pose", "Pose"), "Pose", 50)
STATE: Final = Offer("mission/state", data_id("mission/state", "MissionState"), "MissionState", 100)
BATTERY: Final = Offer("power/battery", data_id("power/battery", "BatteryState"), "BatteryState", 1000)
WORLD: Final = World(description="", bounds=Bounds(x_m=(-100.0, 100.0), y_m=(-100.0, 100.0)))
LOSS: Final = 0.01


class Platform:
    """What of one platform has a say in how often it sends."""

    def __init__(self, index: int, names: list[str], chance: random.Random) -> None:
        self.name = names[index]
        self.hw = hardware_id(self.name)
        start = Pose.planar(4.0 * index, 0.0, 0.0, 0.3)
        self.simulation = Simulation(SimConfig(), WORLD, "uav", start, chance.gauss, chance.random)
        self.navigator = Navigator(Config(), self.name, WORLD.origin, AirPilot(Config()))
        identity = Identity(self.hw, self.name, "main", PlatformKind.UAV, 1, b"")
        self.station = Station(
            identity, Mesh(self.hw, 1, SECOND, 0), Counters(), busy_hz=10.0, relay_bytes_s=2200.0
        )
        wants = tuple(
            Want(other, offer.path, offer.type, offer.data_id)
            for other in names
            if other != self.name
            for offer in (POSE, STATE, BATTERY)
        )
        self.station.set_plan(TreePlan(1, (POSE, STATE, BATTERY), wants))
        self.pace = Pace(chance.randrange(SECOND), chance.random)
        self.next_ns = chance.randrange(50 * MS)
        self.beat_ns = chance.randrange(SECOND)
        self.stated = b""
        self.sent = 0
        self.seen: dict[str, tuple[bytes, int]] = {}
        """The newest pose of each other platform, and since when it is known."""

    def live(self, now_ns: int) -> None:
        """Sensors, navigator and the boards that beat."""
        boards = self.station.bulletin.boards
        sample = self.simulation.on_timer(now_ns)
        if sample is not None:
            if sample.imu is not None:
                self.navigator.on_imu(sample.imu, now_ns)
            if sample.gnss is not None:
                self.navigator.on_gnss(sample.gnss, now_ns)
            if sample.vehicle is not None:
                self.navigator.on_vehicle(sample.vehicle)
        step = self.navigator.on_timer(now_ns)
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
                platform.station.on_timer(self.now_ns)
                if self.now_ns >= platform.pace.due_ns:
                    self.tick(index, platform)
            while self.air and self.air[0][0] <= self.now_ns:
                rx_ns, _, index, header, body = heapq.heappop(self.air)
                self.deliver(self.platforms[index], header, body, rx_ns)

    def tick(self, index: int, sender: Platform) -> None:
        station = sender.station
        if sender.pace.urgent or not station.is_idle(self.now_ns):
            sender.pace.left(self.now_ns)
            departure = station.compose(self.now_ns)
            body = codec.encode(departure.tick)
            station.sent(departure.sequence, self.now_ns, len(body) + 38)
            sender.sent += 1
            session = 1 if departure.with_session else None
            header = Header(0, sender.hw, departure.sequence, self.now_ns // 1000 & 0xFFFF_FFFF, session)
            for other in range(len(self.platforms)):
                if other != index and self.chance.random() >= LOSS:
                    self.order += 1
                    delay_ns = self.chance.randrange(1, 5) * MS
                    heapq.heappush(self.air, (self.now_ns + delay_ns, self.order, other, header, body))
        sender.pace.next(self.now_ns, round(1e9 / station.tick_hz()))

    def deliver(self, receiver: Platform, header: Header, body: bytes, rx_ns: int) -> None:
        arrival = receiver.station.on_datagram(header, codec.decode(body), ("h", 1), rx_ns)
        assert arrival is not None
        if arrival.stranger or arrival.links:
            receiver.station.say_hello()
            receiver.pace.hurry(rx_ns, 100 * MS)
        for want, news in arrival.news:
            if want.data_id == POSE.data_id:
                receiver.seen[want.platform] = news.payload, rx_ns


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
        assert all(n.state is LinkState.UP for n in platform.station.mesh.neighbours.all())
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
