"""A swarm at rest sends little, and its first motion is received at once: navigators with noisy
sensors, cores and drivers as in the daemons, datagrams encoded as on the wire, in virtual time."""

from typing import Final

import pytest
from tests.simulation.directory.brokers import BrokerNode

from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.navigator.config import Config
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.core.simulation import Simulation, SimulationOutput
from swarmd.sim.core.vehicle_core import Action, PublishOutput, ReadBoards, VehicleCore
from swarmware.geometry.world import Bounds, World
from swarmware.model.names import data_id
from swarmware.model.platform_kind import PlatformKind
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.chassis import ChassisAction, ChassisOrder
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.net import BoardPublication, BoardSubscription, ConnectionStatus, TreePlan
from swarmware.types.vehicle import Pose, Setpoint, VehicleState

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
    """The parts of one platform that determine its sending rate: vehicle, navigator, broker."""

    def __init__(self, air: VirtualSwarm[str], index: int, names: list[str]) -> None:
        self.air = air
        self.name = names[index]
        start = Pose.planar(4.0 * index, 0.0, 0.0, 0.3)
        chance = air.random
        simulation = Simulation(SimConfig(), WORLD, PlatformKind.UAV, start, chance.gauss, chance.random)
        self.vehicle = VehicleCore(SimConfig(), simulation)
        self.navigator = NavigatorCore(Config(), self.name, WORLD.origin, AirController(Config()))
        self.stated = b""
        self.setpoint = Setpoint(0.0)
        self.seen: dict[str, tuple[bytes, int]] = {}
        """The newest pose of each other platform, and since when it is known."""
        self.broker = BrokerNode(air, self.name, VirtualClock(air), on_value=self.on_value)
        wants = tuple(
            BoardSubscription(other, offer.path, offer.type, offer.data_id)
            for other in names
            if other != self.name
            for offer in (POSE, STATE, BATTERY)
        )
        plan = TreePlan(1, (POSE, STATE, BATTERY), wants)
        self.broker.driver.feed(self.broker.core.on_plan(plan, air.now_ns))
        self.simulated = air.drive(self.vehicle, self.perform)
        self.simulated.feed()
        air.every(0.05, self.steer, first_s=chance.uniform(0, 0.05))
        air.every(1.0, self.beat, first_s=chance.random())

    @property
    def sent(self) -> int:
        return self.broker.sent

    def on_value(self, _node: BrokerNode, want: BoardSubscription, value: RemoteValue) -> None:
        if want.data_id == POSE.data_id:
            self.seen[want.platform] = value.payload, self.air.now_ns

    def perform(self, action: Action) -> None:
        now_ns = self.air.now_ns
        match action:
            case ReadBoards():
                self.simulated.feed(self.vehicle.on_command(self.setpoint, now_ns, now_ns))
                self.simulated.feed(self.vehicle.on_boards_read(now_ns))
            case PublishOutput(output):
                self.measure(output, now_ns)

    def measure(self, output: SimulationOutput, now_ns: int) -> None:
        """The sensors' values come to the navigator."""
        if output.imu is not None:
            self.navigator.on_imu(output.imu, now_ns)
        if output.gnss is not None:
            self.navigator.on_gnss(output.gnss, now_ns)
        if output.report is not None:
            self.navigator.on_vehicle(VehicleState(output.report.armed, output.report.landed))

    def steer(self) -> None:
        """One control step."""
        step = self.navigator.step(self.air.now_ns)
        self.setpoint = step.setpoint
        if step.pose is not None:
            self.stated = step.pose.pack()
            self.broker.core.published.boards[POSE.data_id].put(self.stated, True, self.air.now_ns)

    def beat(self) -> None:
        """The boards that are written each second."""
        boards, now_ns = self.broker.core.published.boards, self.air.now_ns
        boards[STATE.data_id].put(b"idle", False, now_ns)
        boards[BATTERY.data_id].put(b"%d" % now_ns, False, now_ns)

    def arm(self) -> None:
        """Starts the motors, and reports it to the vehicle's driver."""
        self.simulated.feed(self.vehicle.on_order(ChassisOrder(1, ChassisAction.ARM), self.air.now_ns))

    def links_up(self) -> list[str]:
        """Neighbours with a link in both directions."""
        table = self.broker.core.report.neighbours(lambda hw: ConnectionStatus.IDLE, self.air.now_ns)
        return [neighbour.platform for neighbour in table.neighbours if neighbour.state == "up"]


@pytest.mark.parametrize(("count", "seed"), [(3, 1), (6, 2)])
def test_resting_swarm_is_quiet_until_motion(count: int, seed: int) -> None:
    air: VirtualSwarm[str] = VirtualSwarm(seed, loss=LOSS)
    names = [f"uav{index + 1}" for index in range(count)]
    platforms = []
    for index in range(count):
        air.run_for(air.random.uniform(0, 0.3))
        platforms.append(Platform(air, index, names))
    air.run_for(18.0)
    before = [platform.sent for platform in platforms]
    air.run_for(20.0)
    for platform, sent in zip(platforms, before, strict=True):
        assert 1.5 < (platform.sent - sent) / 20.0 <= 2.5, "datagrams per second"
        assert len(platform.links_up()) == count - 1
        ages_s = [(air.now_ns - since_ns) / 1e9 for _, since_ns in platform.seen.values()]
        assert len(ages_s) == count - 1
        assert max(ages_s) < 1.2, "the mirrors are confirmed, one lost datagram allowed"

    mover, witness = platforms[0], platforms[1]
    mover.arm()
    mover.navigator.on_goal(Goal(1, GoalKind.TAKEOFF, z_m=5.0), air.now_ns)
    parked = mover.stated
    while mover.stated == parked:
        air.run_for(0.005)
    begin_ns = air.now_ns
    while witness.seen[mover.name][0] == parked:
        air.run_for(0.005)
        assert air.now_ns - begin_ns < 0.2 * SECOND, "the first motion is heard"
    moved, stood = mover.sent, witness.sent
    air.run_for(2.0)
    assert mover.sent - moved >= 18
    assert witness.sent - stood <= 6, "who stands still stays quiet beside one that moves"
