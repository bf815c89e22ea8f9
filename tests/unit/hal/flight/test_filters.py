"""Filters of attitude and motion with noisy sensors and outliers."""

import math
import random

import pytest

from swarmd.hal.core.flight.attitude_filter import AttitudeFilter
from swarmd.hal.core.flight.flight_core import ImuMean
from swarmd.hal.core.flight.motion_filter import MotionFilter
from swarmware.geometry.attitude import from_euler, matrix, to_body
from swarmware.geometry.geodesy import GRAVITY_M_S2, LocalMap, Origin
from swarmware.types.vehicle import GnssFix, Imu

DT_S = 0.01
ORIGIN = Origin(lat_deg=48.0, lon_deg=11.0, alt_ellipsoid_m=500.0)
SECOND = 1_000_000_000


def at(roll: float, pitch: float, yaw: float = 0.0, **more: float) -> Imu:
    """Inertial sample of a body at rest with this attitude."""
    force = to_body(matrix(from_euler(roll, pitch, yaw)), (0.0, 0.0, GRAVITY_M_S2))
    rates = [more.get(name, 0.0) for name in ("wx", "wy", "wz")]
    return Imu(rates[0], rates[1], rates[2], *force, yaw)


def fed(found: AttitudeFilter, imu: Imu, count: int, *, landed: bool = False, accel: float = 0.0) -> None:
    for _ in range(count):
        found.update(imu, DT_S, landed=landed, accelerates_m_s2=accel)


def test_first_sample_gives_attitude_of_vehicle_on_slope() -> None:
    found = AttitudeFilter()
    fed(found, at(0.1, -0.2, 1.0), 1, landed=True)
    assert found.angles_rad() == pytest.approx((0.1, -0.2, 1.0))


def test_a_turn_is_integrated_from_the_gyro() -> None:
    found = AttitudeFilter()
    fed(found, at(0.0, 0.0), 1)
    still = at(0.0, 0.0)
    for _ in range(50):
        turning = Imu(0.4, 0.0, 0.0, 0.0, 0.0, 100.0, None)  # a force that shows nothing
        found.update(turning, DT_S, landed=False, accelerates_m_s2=0.0)
    assert found.angles_rad()[0] == pytest.approx(0.2, abs=1e-6)
    assert still.yaw_rad == 0.0


def test_attitude_error_decays_slowly_in_flight() -> None:
    for landed, left in ((False, math.exp(-0.2)), (True, math.exp(-2.0))):
        found = AttitudeFilter()
        fed(found, at(0.1, 0.0), 1, landed=landed)
        fed(found, at(0.0, 0.0), 100, landed=landed)
        assert found.angles_rad()[0] == pytest.approx(0.1 * left, rel=0.1)


@pytest.mark.parametrize(("force_m_s2", "accel"), [(2 * GRAVITY_M_S2, 0.0), (GRAVITY_M_S2, 3.0)])
def test_while_it_accelerates_the_accelerometer_is_not_believed(force_m_s2: float, accel: float) -> None:
    found = AttitudeFilter()
    fed(found, at(0.0, 0.0), 1)
    aslant = Imu(0.0, 0.0, 0.0, 0.0, force_m_s2 * 0.6, force_m_s2 * 0.8, 0.0)
    fed(found, aslant, 200, accel=accel)
    assert found.angles_rad()[:2] == pytest.approx((0.0, 0.0), abs=1e-9)


def test_bias_of_gyro_is_learnt_and_bounded() -> None:
    found = AttitudeFilter()
    fed(found, at(0.0, 0.0, wx=0.02), 40_000)
    assert found.rates_rad_s[0] == pytest.approx(0.0, abs=0.002)
    assert found.angles_rad()[0] == pytest.approx(0.0, abs=0.02)
    stuck = AttitudeFilter()
    fed(stuck, at(0.0, 0.0, wx=5.0), 2000, landed=True)
    assert stuck.rates_rad_s[0] >= 4.9 - 1e-9


def test_heading_follows_compass_over_north_and_south() -> None:
    found = AttitudeFilter()
    fed(found, at(0.0, 0.0, 3.1), 1)
    fed(found, at(0.0, 0.0, -3.1), 2000)
    assert math.remainder(found.angles_rad()[2] + 3.1, math.tau) == pytest.approx(0.0, abs=0.01)


def fix(x_m: float, y_m: float, z_m: float) -> GnssFix:
    return GnssFix(*LocalMap(ORIGIN).to_wgs84(x_m, y_m, z_m), 0.03, 12)


def test_velocity_follows_accelerations_then_fixes() -> None:
    chance = random.Random(1)
    motion = MotionFilter()
    motion.on_fix(fix(0.0, 0.0, 0.0), 0, 0)
    for tick in range(1, 101):
        motion.predict((1.0, 0.0, GRAVITY_M_S2), DT_S, landed=False)
        if tick % 10 == 0:
            t_s = tick * DT_S
            motion.on_fix(fix(t_s**2 / 2 + chance.gauss(0, 0.02), 0.0, 0.0), tick, tick)
    assert motion.velocity_m_s == pytest.approx((1.0, 0.0, 0.0), abs=0.1)
    for tick in range(101, 1101):
        motion.predict((0.0, 0.05, GRAVITY_M_S2), DT_S, landed=False)  # a tilt that is not known
        if tick % 10 == 0:
            motion.on_fix(fix(0.5 + (tick - 100) * DT_S + chance.gauss(0, 0.02), 0.0, 0.0), tick, tick)
    assert motion.velocity_m_s == pytest.approx((1.0, 0.0, 0.0), abs=0.1)
    assert motion.position_m[0] == pytest.approx(10.5, abs=0.1)


def test_late_fix_is_taken_with_way_since() -> None:
    motion = MotionFilter()
    motion.on_fix(fix(0.0, 0.0, 0.0), 0, 0)
    for tick in range(1, 400):
        now_ns = tick * SECOND // 10
        motion.predict((0.0, 0.0, GRAVITY_M_S2), 0.1, landed=False)
        motion.on_fix(fix(2.0 * (now_ns / SECOND - 0.2), 0.0, 0.0), now_ns - SECOND // 5, now_ns)
    assert motion.position_m[0] == pytest.approx(2.0 * 39.9, abs=0.1)


def test_fix_is_taken_once_and_older_one_never() -> None:
    motion = MotionFilter()
    motion.on_fix(fix(0.0, 0.0, 0.0), 10, 10)
    motion.on_fix(fix(1.0, 0.0, 0.0), 20, 20)
    once = motion.position_m
    motion.on_fix(fix(1.0, 0.0, 0.0), 20, 20)
    motion.on_fix(fix(5.0, 0.0, 0.0), 15, 20)
    assert motion.position_m == once


def test_nothing_moves_before_first_fix() -> None:
    motion = MotionFilter()
    motion.on_height(3.0)
    motion.predict((5.0, 5.0, 5.0), DT_S, landed=False)
    assert motion.velocity_m_s == motion.position_m == (0.0, 0.0, 0.0)


def test_a_landed_vehicle_stands_still() -> None:
    motion = MotionFilter()
    motion.on_fix(fix(0.0, 0.0, 0.0), 0, 0)
    motion.predict((5.0, 0.0, 20.0), 1.0, landed=False)
    assert motion.velocity_m_s[0] == pytest.approx(5.0)
    motion.predict((5.0, 0.0, 20.0), 1.0, landed=True)
    assert motion.velocity_m_s == (0.0, 0.0, 0.0)


def test_sonar_corrects_height_but_box_below_does_not() -> None:
    motion = MotionFilter()
    motion.on_fix(fix(0.0, 0.0, 0.0), 0, 0)
    for _ in range(200):
        motion.predict((0.0, 0.0, GRAVITY_M_S2), DT_S, landed=False)
        motion.on_height(0.2)
    assert motion.position_m[2] == pytest.approx(0.2, abs=0.02)
    for _ in range(200):
        motion.on_height(0.9)
    assert motion.position_m[2] == pytest.approx(0.2, abs=0.02)


def test_mean_of_samples_carries_attitude_and_begins_again() -> None:
    means = ImuMean()
    assert means.take(0.0, 0.0) is None
    means.add(Imu(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.1))
    means.add(Imu(3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 0.2))
    assert means.take(0.3, 0.4) == Imu(2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.2, 0.3, 0.4)
    assert means.take(0.3, 0.4) is None
