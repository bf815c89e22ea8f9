"""A vehicle with its navigator and control in virtual time: driven by hand, given back, out of reach."""

import math
import random

import pytest
from tests.simulation.formation.flight import world
from tests.simulation.seeds import seeds

from swarmd.control.config import Config
from swarmd.control.core.control import Action, ControlCore, Operator, WriteDrive
from swarmd.navigator.config import Config as NavConfig
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.core.simulation import Simulation
from swarmware.errors import Denied
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.control import DriveEvent, DriveMode, DriveRequest
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.vehicle import Pose, Setpoint, VehicleMode, VehicleState

STEP_NS = 5_000_000
S = 1_000_000_000
OPERATORS = (Operator(1, "anna@gcs"), Operator(2, "bert@gcs"))


class Flight:
    """One multirotor: simulation, navigator and control, at steps of 5 ms."""

    def __init__(self, seed: int) -> None:
        chance = random.Random(seed)
        where = world()
        start = where.start_pose("uav", 1, (0.0, 0.0))
        nav = NavConfig()
        self.simulation = Simulation(SimConfig(), where, PlatformKind.UAV, start, chance.gauss, chance.random)
        self.navigator = NavigatorCore(nav, "uav1", where.origin, AirController(nav))
        self.control = ControlCore(Config())
        self.now_ns = 100 * S
        self.truth = start
        self.collisions = 0
        self.manual: tuple[Setpoint, Operator] | None = None
        """Set-point that an operator sends at 10 Hz."""
        self._next_nav_ns = self._next_manual_ns = self.now_ns

    def feed(self, actions: list[Action]) -> None:
        for action in actions:
            if isinstance(action, WriteDrive):
                self.simulation.on_command(action.drive.setpoint, action.stamp_ns)
        self.navigator.on_control(self.control.state)

    def run(self, duration_s: float) -> None:
        end_ns = self.now_ns + round(duration_s * S)
        while self.now_ns < end_ns:
            self.now_ns += STEP_NS
            self._simulate()
            if self.now_ns >= self._next_nav_ns:
                self._next_nav_ns += S // 20
                setpoint = self.navigator.step(self.now_ns).setpoint
                self.feed(self.control.on_setpoint(setpoint, self.now_ns, self.now_ns))
            if self.now_ns >= self._next_manual_ns:
                self._next_manual_ns += S // 10
                if self.manual is not None:
                    setpoint, operator = self.manual
                    self.feed(self.control.on_manual(setpoint, operator.id, self.now_ns, self.now_ns))
            due_ns = self.control.deadline_ns()
            if due_ns is not None and due_ns <= self.now_ns:
                self.feed(self.control.on_timer(self.now_ns))

    def _simulate(self) -> None:
        sample = self.simulation.advance(self.now_ns)
        if sample is None:
            return
        self.truth = sample.truth
        self.collisions += len(sample.collisions)
        if sample.imu is not None:
            self.navigator.on_imu(sample.imu, sample.stamp_ns)
        if sample.gnss is not None:
            self.navigator.on_gnss(sample.gnss, sample.stamp_ns)
        if sample.report is not None:
            self.navigator.on_vehicle(VehicleState(sample.report.armed, sample.report.landed))

    def request(self, event: DriveEvent, operator: Operator = OPERATORS[0], *, take: bool = False) -> None:
        self.feed(self.control.on_request(DriveRequest(event, take), operator, self.now_ns))

    @property
    def speed_m_s(self) -> float:
        return math.hypot(self.truth.vx_m_s, self.truth.vy_m_s, self.truth.vz_m_s)


def airborne(seed: int, height_m: float = 5.0) -> Flight:
    flight = Flight(seed)
    flight.run(1.0)
    flight.simulation.on_arm(True)
    flight.navigator.on_goal(Goal(1, GoalKind.TAKEOFF, z_m=height_m), flight.now_ns)
    flight.run(12.0)
    assert flight.truth.z_m == pytest.approx(height_m, abs=0.6)
    return flight


def distance(a: Pose, b: Pose) -> float:
    return math.dist((a.x_m, a.y_m, a.z_m), (b.x_m, b.y_m, b.z_m))


@pytest.mark.parametrize("seed", seeds(3, 20))
def test_vehicle_without_manual_set_points_holds_position(seed: int) -> None:
    flight = airborne(seed)
    flight.request(DriveEvent.DRIVE)
    flight.manual = (Setpoint(2.0, 0.0, 0.5, 0.2), OPERATORS[0])
    flight.run(3.0)
    assert flight.speed_m_s > 1.5
    flight.manual = None
    flight.run(0.4)
    assert flight.control.state.mode is DriveMode.HOLD
    flight.run(3.0)
    here = flight.truth
    assert flight.speed_m_s < 0.2
    flight.run(30.0)
    assert distance(here, flight.truth) < 0.5


@pytest.mark.parametrize("seed", seeds(3, 20))
def test_returned_vehicle_stays_and_forgets_former_goal(seed: int) -> None:
    flight = airborne(seed)
    flight.request(DriveEvent.DRIVE)
    flight.manual = (Setpoint(1.5, 0.0, 0.8), OPERATORS[0])
    flight.run(4.0)
    flight.manual = (Setpoint(0.0), OPERATORS[0])
    flight.run(3.0)
    here = flight.truth
    flight.manual = None
    flight.request(DriveEvent.RELEASE)
    flight.run(15.0)
    assert flight.control.state.mode is DriveMode.AUTO
    assert distance(here, flight.truth) < 1.0


@pytest.mark.parametrize("seed", seeds(3, 20))
def test_unreached_goal_continues_after_manual_control(seed: int) -> None:
    flight = airborne(seed)
    x, y = flight.truth.x_m + 12.0, flight.truth.y_m
    flight.navigator.on_goal(Goal(2, GoalKind.GOTO, x_m=x, y_m=y, z_m=5.0, speed_m_s=2.0), flight.now_ns)
    flight.run(2.0)
    flight.request(DriveEvent.DRIVE)
    flight.manual = (Setpoint(0.0, 1.0), OPERATORS[0])
    flight.run(5.0)
    flight.manual = None
    flight.request(DriveEvent.RELEASE)
    flight.run(20.0)
    assert math.dist((flight.truth.x_m, flight.truth.y_m), (x, y)) < 0.6


@pytest.mark.parametrize("seed", seeds(5, 100))
def test_one_source_at_most_drives_and_silence_holds(seed: int) -> None:
    """With no seed the vehicle still moves 3 s after all operators are silent in a mode other than auto."""
    chance = random.Random(seed)
    flight = airborne(seed)
    for _ in range(25):
        operator = chance.choice(OPERATORS)
        match chance.randrange(6):
            case 0 | 1:
                event = chance.choice([DriveEvent.DRIVE, DriveEvent.RELEASE, DriveEvent.ORDER])
                try:
                    flight.request(event, operator, take=chance.random() < 0.3)
                except Denied as error:
                    assert "stick" in str(error) or "safety pilot" in str(error)
            case 2:
                position = chance.choice([VehicleMode.AUTO, VehicleMode.MANUAL])
                flight.feed(flight.control.on_switch(position, flight.now_ns))
            case 3:
                flight.manual = None
            case _:
                flight.manual = (Setpoint(chance.uniform(-1, 1), chance.uniform(-1, 1)), operator)
        flight.run(chance.uniform(0.0, 1.0))
        state = flight.control.state
        assert (state.mode in (DriveMode.MANUAL, DriveMode.HOLD)) == bool(state.holder)
    flight.manual = None
    flight.run(4.0)
    assert flight.control.state.mode is not DriveMode.MANUAL
    assert flight.speed_m_s < 0.3
