"""The estimator: accuracy with given sensors, and invalid poses when they fail."""

import math
import random
from collections.abc import Callable
from statistics import mean

import pytest

from swarmd.navigator.config import EstimatorConfig
from swarmd.navigator.core.estimator import Estimator
from swarmd.sim.config import SensorsConfig
from swarmd.sim.core.sensors import SensorErrors
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.geometry.kalman_axis import KalmanAxis
from swarmware.geometry.world import Bounds, World
from swarmware.types.vehicle import GnssFix, Imu, Pose

WORLD = World(description="", bounds=Bounds(x_m=(-100.0, 100.0), y_m=(-100.0, 100.0)))
MS = 1_000_000
Motion = Callable[[float], tuple[Pose, tuple[float, float, float]]]
"""Truth and body acceleration at a time in seconds."""


def measured(sensors: SensorErrors, pose: Pose, acceleration: tuple[float, float, float]) -> Imu:
    """Inertial sample of a level body."""
    ahead, aside, up = acceleration
    return sensors.imu(pose, (0.0, 0.0, pose.wz_rad_s), (ahead, aside, up + GRAVITY_M_S2))


def circle(t: float) -> tuple[Pose, tuple[float, float, float]]:
    speed, rate = 2.0, 0.25
    yaw = rate * t
    radius = speed / rate
    velocity = (speed * math.cos(yaw), speed * math.sin(yaw), 0.0)
    pose = Pose.planar(radius * math.sin(yaw), radius * (1 - math.cos(yaw)), 2.0, yaw, velocity, rate)
    return pose, (0.0, speed * rate, 0.0)


def follow(
    motion: Motion, seconds: float, delay_ms: int = 40, config: SensorsConfig | None = None, seed: int = 1
) -> list[float]:
    """Position errors of an estimator whose measurements arrive late."""
    chance = random.Random(seed)
    sensors = SensorErrors(config or SensorsConfig(), WORLD, chance.gauss, chance.random)
    estimator = Estimator(EstimatorConfig(), WORLD.origin)
    errors = []
    fixes: list[tuple[int, GnssFix]] = []
    for ms in range(0, round(seconds * 1000), 10):
        pose, acceleration = motion(ms / 1000)
        if ms % 20 == 0:
            estimator.on_imu(measured(sensors, pose, acceleration), ms * MS)
        if ms % 100 == 0:
            fixes.append((ms, sensors.gnss(pose, 0.1)))
        while fixes and fixes[0][0] <= ms - delay_ms:
            stamp_ms, fix = fixes.pop(0)
            estimator.on_gnss(fix, stamp_ms * MS)
        if ms % 50 == 0:
            estimator.predict(ms * MS)
            found = estimator.pose()
            if found is not None and ms > 3000:
                errors.append(math.hypot(found.x_m - pose.x_m, found.y_m - pose.y_m))
    return errors


@pytest.mark.parametrize("seed", range(5))
def test_a_moving_vehicle_is_known_to_a_hand(seed: int) -> None:
    errors = follow(circle, 30.0, seed=seed)
    assert mean(errors) < 0.1
    assert max(errors) < 0.2


def test_late_fixes_are_carried_to_now() -> None:
    exact = SensorsConfig(gnss_bias_sigma_m=0.0, yaw_bias_sigma_rad=0.0)
    errors = follow(circle, 20.0, delay_ms=200, config=exact)
    assert mean(errors) < 0.08  # 0.4 m of way lie between measurement and use


def weaving(t: float) -> tuple[Pose, tuple[float, float, float]]:
    """Straight on at 2 m/s, a little faster and slower each second."""
    speed, accel = 2.0 + 0.3 * math.sin(math.tau * t), 0.3 * math.tau * math.cos(math.tau * t)
    way = 2.0 * t - 0.3 / math.tau * (math.cos(math.tau * t) - 1)
    return Pose.planar(way, 0.0, 0.0, 0.0, (speed, 0.0, 0.0)), (accel, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_velocity_stays_bounded_with_one_sample(seed: int) -> None:
    chance = random.Random(seed)
    sensors = SensorErrors(SensorsConfig(), WORLD, chance.gauss, chance.random)
    estimator = Estimator(EstimatorConfig(), WORLD.origin)
    worst_m = worst_m_s = 0.0
    ms = 0
    while ms < 60_000:
        pose, acceleration = weaving(ms / 1000)
        estimator.on_imu(measured(sensors, pose, acceleration), ms * MS)
        estimator.on_gnss(sensors.gnss(pose, 0.1), ms * MS)
        estimator.predict(ms * MS)
        found = estimator.pose()
        if found is not None and ms > 5000:
            worst_m = max(worst_m, math.hypot(found.x_m - pose.x_m, found.y_m - pose.y_m))
            worst_m_s = max(worst_m_s, abs(found.vx_m_s - pose.vx_m_s))
        ms += chance.choice((200, 300, 400, 600, 900))  # the turns of a late event loop
    assert worst_m < 0.2
    assert worst_m_s < 1.5


def test_compass_decides_after_gap_in_samples() -> None:
    estimator = Estimator(EstimatorConfig(), WORLD.origin)
    for ms, yaw, rate in ((0, 0.0, 0.0), (50, 0.0, 1.5), (850, 0.4, 0.0)):
        fast = Imu(0.0, 0.0, rate, 0.0, 0.0, GRAVITY_M_S2, yaw)
        estimator.on_imu(fast, ms * MS)
        estimator.on_gnss(GnssFix(WORLD.origin.lat_deg, WORLD.origin.lon_deg, 0.0, 0.02, 12), ms * MS)
        estimator.predict(ms * MS)
    pose = estimator.pose()
    assert pose is not None
    assert pose.yaw_rad == pytest.approx(0.4, abs=0.01)


def test_velocity_and_heading_follow_too() -> None:
    chance = random.Random(3)
    sensors = SensorErrors(SensorsConfig(), WORLD, chance.gauss, chance.random)
    estimator = Estimator(EstimatorConfig(), WORLD.origin)
    for ms in range(0, 10_000, 50):
        pose, acceleration = circle(ms / 1000)
        estimator.on_imu(measured(sensors, pose, acceleration), ms * MS)
        if ms % 100 == 0:
            estimator.on_gnss(sensors.gnss(pose, 0.1), ms * MS)
        estimator.predict(ms * MS)
    found = estimator.pose()
    assert found is not None
    assert (found.vx_m_s, found.vy_m_s) == pytest.approx((pose.vx_m_s, pose.vy_m_s), abs=0.2)
    assert math.remainder(found.yaw_rad - pose.yaw_rad, math.tau) == pytest.approx(0.0, abs=0.05)


def fed(until_ms: int, *, gnss: bool = True, imu: bool = True) -> Estimator:
    estimator = Estimator(EstimatorConfig(), WORLD.origin)
    for ms in range(0, until_ms, 50):
        if imu:
            estimator.on_imu(Imu(0.0, 0.0, 0.0, 0.0, 0.0, 9.80665, 0.0), ms * MS)
        if gnss:
            estimator.on_gnss(GnssFix(0.0, 0.0, 0.0, 0.05, 12), ms * MS)
        estimator.predict(ms * MS)
    return estimator


def test_pose_needs_first_fix_and_heading() -> None:
    assert fed(2000, gnss=False).pose() is None
    assert fed(2000, imu=False).pose() is None
    assert fed(2000).pose() is not None


@pytest.mark.parametrize(("sensor", "limit_ms"), [("gnss", 1000), ("imu", 500)])
def test_pose_ends_when_sensor_is_silent(sensor: str, limit_ms: int) -> None:
    estimator = fed(2000)
    for ms in range(2000, 2000 + limit_ms + 200, 50):
        if sensor != "imu":
            estimator.on_imu(Imu(0.0, 0.0, 0.0, 0.0, 0.0, 9.80665, 0.0), ms * MS)
        if sensor != "gnss":
            estimator.on_gnss(GnssFix(0.0, 0.0, 0.0, 0.05, 12), ms * MS)
        estimator.predict(ms * MS)
        if ms < 1950 + limit_ms:
            assert estimator.pose() is not None
    assert estimator.pose() is None


def test_delay_of_step_is_no_silence_of_sensors() -> None:
    estimator = fed(2000, imu=True)
    estimator.predict(2600 * MS)
    assert estimator.pose() is None, "for a step in time the inertial unit has been silent for too long"
    assert estimator.pose(400 * MS) is not None
    estimator.predict(4600 * MS)
    assert estimator.pose(3000 * MS) is None, "two seconds at most are put down to the processor"


def test_an_old_fix_changes_nothing() -> None:
    estimator = fed(1000)
    before = estimator.pose()
    estimator.on_gnss(GnssFix(1.0, 1.0, 0.0, 0.01, 12), 500 * MS)
    estimator.predict(950 * MS)
    assert estimator.pose() == before


def test_tilted_force_is_levelled_by_attitude() -> None:
    # a multirotor accelerates by its tilt: the accelerometer itself feels nothing forward
    pitch = 0.2
    lift = GRAVITY_M_S2 / math.cos(pitch)
    for attitude, speed in (((0.0, pitch), GRAVITY_M_S2 * math.tan(pitch)), ((None, None), 0.0)):
        estimator = fed(1000)
        for ms in range(1000, 2000, 10):
            estimator.on_imu(Imu(0.0, 0.0, 0.0, 0.0, 0.0, lift, 0.0, *attitude), ms * MS)
            estimator.predict(ms * MS)
        estimator.on_gnss(GnssFix(0.0, 0.0, 0.0, 50.0, 4), 1990 * MS)
        estimator.predict(1990 * MS)
        pose = estimator.pose()
        assert pose is not None
        assert pose.vx_m_s == pytest.approx(speed, abs=0.15)


def test_the_sonar_corrects_the_height() -> None:
    estimator = fed(1000)
    for ms in range(1000, 3000, 50):
        estimator.on_imu(Imu(0.0, 0.0, 0.0, 0.0, 0.0, 9.80665, 0.0), ms * MS)
        estimator.on_gnss(GnssFix(0.0, 0.0, 0.3, 0.2, 12), ms * MS)
        estimator.on_height(0.0)
        estimator.predict(ms * MS)
    pose = estimator.pose()
    assert pose is not None
    assert abs(pose.z_m) < 0.05


def test_an_axis_becomes_as_sure_as_theory_says() -> None:
    # steady state of the filter driven by white acceleration: Kalata's tracking index, 1984
    dt, accel, sigma = 0.1, 0.3, 0.02
    axis = KalmanAxis(0.0, 1.0, accel)
    for _ in range(500):
        axis.predict(0.0, dt)
        axis.update(0.0, sigma)
    index = accel * dt * dt / sigma
    r = (4 + index - math.sqrt(8 * index + index * index)) / 4
    alpha = 1 - r * r
    assert axis.pp == pytest.approx(alpha * sigma * sigma, rel=0.02)
