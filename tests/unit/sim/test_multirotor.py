"""The multirotor: lag, limits, take-off, landing, falling."""

import math

import pytest

from swarmd.sim.config import MultirotorLimits
from swarmd.sim.core.multirotor import Multirotor
from swarmware.types.vehicle import Pose, Setpoint

DT = 0.02
LIMITS = MultirotorLimits()


def flying(z_m: float = 10.0, yaw_rad: float = 0.0) -> Multirotor:
    vehicle = Multirotor(LIMITS, Pose.planar(0.0, 0.0, z_m, yaw_rad))
    vehicle.armed = True
    return vehicle


def run(vehicle: Multirotor, wanted: Setpoint, seconds: float) -> list[float]:
    return [vehicle.step(wanted, DT) for _ in range(round(seconds / DT))]


def test_velocity_step_is_answered_with_time_constant() -> None:
    vehicle = flying()
    run(vehicle, Setpoint(1.0), LIMITS.tau_s)
    assert vehicle.pose().vx_m_s == pytest.approx(1 - math.exp(-1), abs=0.02)
    run(vehicle, Setpoint(1.0), 3.0)
    assert vehicle.pose().vx_m_s == pytest.approx(1.0, abs=0.001)


def test_large_step_is_limited_by_acceleration_and_speed() -> None:
    vehicle = flying()
    run(vehicle, Setpoint(100.0), 0.5)
    assert vehicle.pose().vx_m_s == pytest.approx(LIMITS.a_max_m_s2 * 0.5, rel=0.01)
    run(vehicle, Setpoint(100.0), 5.0)
    assert vehicle.pose().vx_m_s == pytest.approx(LIMITS.v_max_m_s, rel=0.01)


def test_set_points_are_in_the_body_frame() -> None:
    vehicle = flying(yaw_rad=math.pi / 2)
    run(vehicle, Setpoint(1.0, 0.5), 4.0)
    pose = vehicle.pose()
    assert (pose.vx_m_s, pose.vy_m_s) == pytest.approx((-0.5, 1.0), abs=0.01)


def test_climb_and_sink_have_their_own_limits() -> None:
    up, down = flying(), flying(50.0)
    run(up, Setpoint(0.0, 0.0, 9.0), 4.0)
    run(down, Setpoint(0.0, 0.0, -9.0), 4.0)
    assert up.pose().vz_m_s == pytest.approx(LIMITS.climb_max_m_s, rel=0.01)
    assert down.pose().vz_m_s == pytest.approx(-LIMITS.sink_max_m_s, rel=0.01)


def test_only_armed_climbing_vehicle_leaves_ground() -> None:
    vehicle = Multirotor(LIMITS, Pose.planar(1.0, 2.0))
    run(vehicle, Setpoint(0.0, 0.0, 1.0), 1.0)
    assert vehicle.pose().z_m == 0.0
    vehicle.armed = True
    run(vehicle, Setpoint(1.0), 1.0)
    assert vehicle.pose() == Pose.planar(1.0, 2.0)
    run(vehicle, Setpoint(0.0, 0.0, 1.0), 2.0)
    assert not vehicle.landed
    assert vehicle.pose().z_m > 1.0


def test_a_soft_landing_is_no_impact() -> None:
    vehicle = flying(1.0)
    impacts = run(vehicle, Setpoint(0.0, 0.0, -0.5), 4.0)
    assert vehicle.landed
    assert max(impacts) == 0.0
    assert vehicle.pose().z_m == 0.0


def test_hard_landing_is_impact_with_its_speed() -> None:
    vehicle = flying(5.0)
    impacts = [speed for speed in run(vehicle, Setpoint(0.0, 0.0, -2.0), 5.0) if speed > 0]
    assert impacts == [pytest.approx(2.0, abs=0.05)]


def test_without_motors_it_falls() -> None:
    vehicle = flying(4.905)
    vehicle.armed = False
    impacts = [speed for speed in run(vehicle, Setpoint(0.0, 0.0, 1.0), 2.0) if speed > 0]
    assert impacts == [pytest.approx(9.8, abs=0.3)]
    assert vehicle.landed


def test_yaw_follows_its_rate() -> None:
    vehicle = flying()
    run(vehicle, Setpoint(0.0, 0.0, 0.0, 0.5), 3.0)
    assert vehicle.pose().wz_rad_s == pytest.approx(0.5, abs=0.01)
    assert vehicle.pose().yaw_rad == pytest.approx(0.5 * (3.0 - LIMITS.w_tau_s), abs=0.02)


def test_power_grows_from_standing_to_flying() -> None:
    standing = Multirotor(LIMITS, Pose.planar(0.0, 0.0)).power_w()
    vehicle = flying()
    hovering = vehicle.power_w()
    run(vehicle, Setpoint(5.0), 2.0)
    assert standing < hovering < vehicle.power_w()
