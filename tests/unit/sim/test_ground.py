"""The ground vehicle: S0's equations, and a drive with limits."""

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.sim.config import GroundLimits
from swarmd.sim.core.ground import Ground, GroundState, advance
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.vehicle import Pose, Setpoint

DT = 0.02


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1), st.floats(-3, 3), st.floats(-1.5, 1.5))
def test_a_sample_is_f_x_plus_b_u(x: float, y: float, yaw: float, v: float, w: float) -> None:
    state = np.array([x, y, yaw, 0.7, -0.3])
    f = np.diag([1.0, 1.0, 1.0, 0.0, 0.0])
    b = np.array([[math.cos(yaw) * DT, 0], [math.sin(yaw) * DT, 0], [0, DT], [1, 0], [0, 1]])
    expected = f @ state + b @ np.array([v, w])
    found = advance(GroundState(x, y, yaw, 0.7, -0.3), v, w, DT)
    expected[2] = math.remainder(expected[2], math.tau)
    assert (found.x_m, found.y_m, found.yaw_rad, found.v_m_s, found.w_rad_s) == pytest.approx(tuple(expected))


def ground() -> Ground:
    vehicle = Ground(GroundLimits(), Pose.planar(0.0, 0.0))
    vehicle.armed = True
    return vehicle


def test_a_disarmed_vehicle_does_not_move() -> None:
    vehicle = ground()
    vehicle.armed = False
    for _ in range(50):
        vehicle.step(Setpoint(2.0, 0.0, 0.0, 1.0), DT)
    assert vehicle.pose() == Pose.planar(0.0, 0.0)


def test_the_drive_keeps_its_limits_whatever_is_asked() -> None:
    vehicle, limits = ground(), GroundLimits()
    chance = random.Random(1)
    v = w = 0.0
    for _ in range(2000):
        vehicle.step(Setpoint(chance.uniform(-9, 9), 5.0, 5.0, chance.uniform(-9, 9)), DT)
        state = vehicle.state
        assert -limits.v_back_m_s - 1e-9 <= state.v_m_s <= limits.v_max_m_s + 1e-9
        assert abs(state.w_rad_s) <= limits.w_max_rad_s + 1e-9
        assert abs(state.v_m_s - v) <= limits.a_max_m_s2 * DT + 1e-9
        assert abs(state.w_rad_s - w) <= limits.dw_max_rad_s2 * DT + 1e-9
        v, w = state.v_m_s, state.w_rad_s


def test_constant_speeds_drive_a_circle() -> None:
    vehicle = ground()
    for _ in range(200):
        vehicle.step(Setpoint(1.0, 0.0, 0.0, 0.5), DT)
    begin = vehicle.pose()
    for _ in range(round(math.tau / 0.5 / DT)):
        vehicle.step(Setpoint(1.0, 0.0, 0.0, 0.5), DT)
    end = vehicle.pose()
    assert math.dist((begin.x_m, begin.y_m), (end.x_m, end.y_m)) < 0.05


def test_acceleration_is_felt_forward_and_centripetal() -> None:
    vehicle = ground()
    vehicle.step(Setpoint(3.0), DT)
    assert vehicle.specific_force() == pytest.approx((2.0, 0.0, GRAVITY_M_S2))
    for _ in range(200):
        vehicle.step(Setpoint(2.0, 0.0, 0.0, 0.5), DT)
    assert vehicle.specific_force() == pytest.approx((0.0, 1.0, GRAVITY_M_S2))


def test_driving_costs_more_than_standing() -> None:
    vehicle = ground()
    standing = vehicle.power_w()
    vehicle.step(Setpoint(3.0), DT)
    assert vehicle.power_w() > standing
