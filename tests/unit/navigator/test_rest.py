"""A vehicle at rest: constant pose within the stated accuracy, and the end of the rest by a motion."""

import math
import random
from collections.abc import Callable
from itertools import pairwise
from statistics import mean

import pytest

from swarmd.navigator.config import Config, EstimatorConfig
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.estimator import Estimator
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.sim.config import SensorsConfig
from swarmd.sim.core.sensors import SensorErrors
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.geometry.world import Bounds, World
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.vehicle import Imu, Pose, VehicleState

WORLD = World(description="", bounds=Bounds(x_m=(-100.0, 100.0), y_m=(-100.0, 100.0)))
MS = 1_000_000
START = Pose.planar(3.0, -2.0, 0.0, 0.5)
REST_MS = round(1000 / Config().rest_hz)
MOVING_MS = round(1000 / Config().rate_hz)
Way = Callable[[float], tuple[float, float, float]]
"""Distance, speed and acceleration along the heading, at a time in seconds."""


def measured(sensors: SensorErrors, pose: Pose, acceleration: tuple[float, float, float]) -> Imu:
    """Inertial sample of a level body."""
    ahead, aside, up = acceleration
    return sensors.imu(pose, (0.0, 0.0, pose.wz_rad_s), (ahead, aside, up + GRAVITY_M_S2))


class Parked:
    """An estimator with the sensors of a vehicle that is not driven."""

    def __init__(
        self, seed: int, config: SensorsConfig | None = None, way: Way | None = None, period_ms: int = REST_MS
    ) -> None:
        self.chance = random.Random(seed)
        self.sensors = SensorErrors(config or SensorsConfig(), WORLD, self.chance.gauss, self.chance.random)
        self.estimator = Estimator(EstimatorConfig(), WORLD.origin)
        self.estimator.on_driven(False)
        self.way: Way = way or (lambda _: (0.0, 0.0, 0.0))
        self.tilt_m_s2 = 0.0
        self.ms = 0
        self.period_ms = period_ms

    def truth(self) -> tuple[Pose, float]:
        distance, speed, accel = self.way(self.ms / 1000)
        cos, sin = math.cos(0.5), math.sin(0.5)
        where = (START.x_m + distance * cos, START.y_m + distance * sin)
        return Pose.planar(*where, 0.0, 0.5, (speed * cos, speed * sin, 0.0)), accel

    def step(self) -> Pose | None:
        """Advances by one period, and samples the sensors at its end."""
        self.ms += self.period_ms
        pose, accel = self.truth()
        self.estimator.on_imu(measured(self.sensors, pose, (accel + self.tilt_m_s2, 0.0, 0.0)), self.ms * MS)
        fix_ms = max(self.period_ms, 100)
        if self.ms % fix_ms == 0:
            self.estimator.on_gnss(self.sensors.gnss(pose, fix_ms / 1000), self.ms * MS)
        self.estimator.on_height(self.chance.gauss(0.0, 0.02))
        self.estimator.predict(self.ms * MS)
        return self.estimator.pose()

    def run(self, until_s: float) -> list[Pose]:
        """Poses until then."""
        found = []
        while self.ms < until_s * 1000:
            if (pose := self.step()) is not None:
                found.append(pose)
        return found


@pytest.mark.parametrize("seed", range(5))
def test_the_pose_of_a_parked_vehicle_stands_still(seed: int) -> None:
    parked = Parked(seed)
    parked.run(3.0)
    assert parked.estimator.at_rest
    stated = [pose.pack() for pose in parked.run(33.0)]
    changes = sum(before != after for before, after in pairwise(stated))
    assert changes <= 3, "in half a minute"


def test_position_of_parked_vehicle_is_within_centimetres() -> None:
    squares = []
    for seed in range(25):
        parked = Parked(seed)
        parked.run(30.0)
        pose = parked.estimator.pose()
        assert pose is not None
        error = math.dist((pose.x_m, pose.y_m), (START.x_m, START.y_m))
        assert error < 0.15
        squares.append(error**2)
    assert math.sqrt(mean(squares)) < 0.07, "root mean square of the error in metres"


def test_a_slope_and_a_bias_are_no_motion() -> None:
    parked = Parked(1)
    parked.tilt_m_s2 = 1.2
    parked.run(3.0)
    assert parked.estimator.at_rest


def push(accel: float, speed: float, at_s: float = 10.0) -> Way:
    def way(t: float) -> tuple[float, float, float]:
        since = t - at_s
        if since <= 0:
            return 0.0, 0.0, 0.0
        rise = speed / accel
        if since < rise:
            return accel * since**2 / 2, accel * since, accel
        return speed * (since - rise / 2), speed, 0.0

    return way


@pytest.mark.parametrize(
    ("accel", "speed", "within_s"), [(2.0, 1.0, 0.25), (1.0, 0.5, 0.3), (0.2, 0.4, 2.5), (0.05, 0.2, 4.5)]
)
@pytest.mark.parametrize("seed", range(4))
def test_pushed_vehicle_is_not_held(accel: float, speed: float, within_s: float, seed: int) -> None:
    parked = Parked(seed, way=push(accel, speed))
    parked.run(10.0)
    rested = [parked.estimator.at_rest]
    parked.run(10.0 + within_s)
    assert [*rested, parked.estimator.at_rest] == [True, False]
    errors = []
    while parked.ms < 25_000:
        pose, (truth, _) = parked.step(), parked.truth()
        assert pose is not None
        errors.append(math.dist((pose.x_m, pose.y_m), (truth.x_m, truth.y_m)))
    assert max(errors) < 0.4
    assert mean(errors) < 0.15


def test_one_fix_that_is_metres_off_moves_nobody() -> None:
    parked = Parked(2)
    before = parked.run(20.0)[-1]
    fix = parked.sensors.gnss(Pose.planar(START.x_m + 30.0, START.y_m), 0.1)
    parked.estimator.on_gnss(fix, parked.ms * MS)
    after = parked.run(21.0)[-1]
    assert parked.estimator.at_rest
    assert math.dist((before.x_m, before.y_m), (after.x_m, after.y_m)) < 0.02


def test_a_turn_on_the_spot_is_seen() -> None:
    parked = Parked(3)
    parked.run(10.0)
    for ms in range(10_000, 10_300, 20):
        parked.estimator.on_imu(Imu(0.0, 0.0, 0.5, 0.0, 0.0, 9.80665), ms * MS)
        parked.estimator.predict(ms * MS)
    assert not parked.estimator.at_rest
    pose = parked.estimator.pose()
    assert pose is not None
    assert pose.wz_rad_s == 0.5


def test_without_inertial_unit_nothing_is_at_rest() -> None:
    parked = Parked(4)
    parked.run(10.0)
    parked.estimator.predict(parked.ms * MS + 600 * MS)
    assert not parked.estimator.at_rest


def test_armed_climbing_vehicle_is_never_held() -> None:
    parked = Parked(5)
    navigator = NavigatorCore(Config(), "uav1", WORLD.origin, AirController(Config()))
    navigator.on_vehicle(VehicleState(armed=False, landed=True))

    def step() -> Pose | None:
        parked.step()
        truth, _ = parked.truth()
        navigator.on_imu(measured(parked.sensors, truth, (0.0, 0.0, 0.0)), parked.ms * MS)
        navigator.on_gnss(parked.sensors.gnss(truth, 0.1), parked.ms * MS)
        return navigator.step(parked.ms * MS).pose

    stated = {step() for _ in range(100)}
    stated = {step() for _ in range(100)}
    assert len(stated) <= 2
    navigator.on_vehicle(VehicleState(armed=True, landed=True))
    assert step() in stated, "armed without a set-point it still stands"
    navigator.on_goal(Goal(1, GoalKind.TAKEOFF, z_m=5.0), parked.ms * MS)
    step()
    navigator.on_vehicle(VehicleState(armed=True, landed=False))
    moving = [step() for _ in range(4)]
    assert len(set(moving)) == 4
