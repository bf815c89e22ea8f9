"""The rigid body: laws of mechanics with analytical solutions."""

import math

import pytest

from swarmd.sim.core.rigid_body import RigidBody
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2

NONE: Vector = (0.0, 0.0, 0.0)
DT_S = 0.0025


def body(inertia: Vector = (0.02, 0.03, 0.05)) -> RigidBody:
    return RigidBody(2.0, inertia, (0.0, 0.0, 100.0), 0.0)


def test_a_body_without_forces_falls_and_feels_nothing() -> None:
    falling = body()
    for _ in range(400):
        falling.step(NONE, NONE, DT_S)
    assert falling.velocity_m_s == pytest.approx((0.0, 0.0, -GRAVITY_M_S2))
    assert falling.position_m[2] == pytest.approx(100.0 - GRAVITY_M_S2 / 2)
    assert falling.specific_force_m_s2 == NONE


def test_force_forward_accelerates_to_where_nose_points() -> None:
    pushed = RigidBody(2.0, (0.02, 0.03, 0.05), NONE, math.pi / 2)
    for _ in range(400):
        pushed.step((4.0, 0.0, 2.0 * GRAVITY_M_S2), NONE, DT_S)
    assert pushed.velocity_m_s == pytest.approx((0.0, 2.0, 0.0), abs=1e-9)
    assert pushed.position_m == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)


def test_moment_turns_by_inertia_of_its_axis() -> None:
    for axis, inertia in enumerate((0.02, 0.03, 0.05)):
        turned = body()
        moment = [0.0, 0.0, 0.0]
        moment[axis] = 0.01
        for _ in range(400):
            turned.step(NONE, (moment[0], moment[1], moment[2]), DT_S)
        assert turned.rates_rad_s[axis] == pytest.approx(0.01 / inertia)
        assert turned.angles_rad()[axis] == pytest.approx(0.005 / inertia, rel=0.01)


def test_tumbling_body_keeps_momentum_and_energy() -> None:
    tumbling = body()
    tumbling.rates_rad_s = (1.0, 2.0, 0.5)

    def momentum() -> Vector:
        p, q, r = tumbling.rates_rad_s
        return tumbling.to_map((0.02 * p, 0.03 * q, 0.05 * r))

    def energy() -> float:
        p, q, r = tumbling.rates_rad_s
        return (0.02 * p * p + 0.03 * q * q + 0.05 * r * r) / 2

    before, then = momentum(), energy()
    for _ in range(2000):
        tumbling.step(NONE, NONE, DT_S)
    assert momentum() == pytest.approx(before, abs=0.02 * math.hypot(*before))
    assert energy() == pytest.approx(then, rel=0.02)


def test_turn_about_middle_axis_does_not_stay_one() -> None:
    # intermediate axis theorem
    flipping = body()
    flipping.rates_rad_s = (0.001, 5.0, 0.0)
    middle = []
    for _ in range(4000):
        flipping.step(NONE, NONE, DT_S)
        middle.append(flipping.rates_rad_s[1])
    assert min(middle) < -4.5


def test_resting_body_feels_gravity_in_own_axes() -> None:
    resting = body()
    resting.step(NONE, (0.5, 0.0, 0.0), 0.1)
    roll = resting.angles_rad()[0]
    assert roll != 0.0
    resting.rest((1.0, 2.0, 3.0))
    assert resting.rates_rad_s == resting.velocity_m_s == NONE
    assert resting.specific_force_m_s2 == pytest.approx(
        (0.0, GRAVITY_M_S2 * math.sin(roll), GRAVITY_M_S2 * math.cos(roll))
    )
    resting.stand(0.0)
    assert resting.up == pytest.approx(1.0)
    assert resting.position_m == (1.0, 2.0, 0.0)
    assert resting.specific_force_m_s2 == pytest.approx((0.0, 0.0, GRAVITY_M_S2))


def test_a_body_that_slides_keeps_its_direction() -> None:
    sliding = body()
    sliding.velocity_m_s = (3.0, 4.0, 0.0)
    sliding.slide(2.5, 0.1)
    assert sliding.velocity_m_s == pytest.approx((1.5, 2.0, 0.0))
    assert sliding.position_m[:2] == pytest.approx((0.3, 0.4))
