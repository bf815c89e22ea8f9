"""Attitudes: quaternions, Euler angles and matrices are the same turn."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.geometry.attitude import (
    LEVEL,
    Vector,
    from_euler,
    levelled,
    matrix,
    to_body,
    to_euler,
    to_map,
    turned,
)
from swarmware.types.vehicle import Pose

ANGLES = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
VECTORS = st.tuples(st.floats(-10, 10), st.floats(-10, 10), st.floats(-10, 10))


@given(ANGLES)
def test_euler_angles_survive_the_quaternion(angles: Vector) -> None:
    assert to_euler(from_euler(*angles)) == pytest.approx(angles, abs=1e-9)


@given(ANGLES, VECTORS)
def test_rotation_to_map_and_back_is_identity(angles: Vector, vector: Vector) -> None:
    m = matrix(from_euler(*angles))
    assert to_body(m, to_map(m, vector)) == pytest.approx(vector, abs=1e-9)


def test_left_turn_points_north_pitch_lowers_nose() -> None:
    assert to_map(matrix(from_euler(0, 0, math.pi / 2)), (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))
    assert to_map(matrix(from_euler(0, 0.5, 0)), (1.0, 0.0, 0.0))[2] == pytest.approx(-math.sin(0.5))
    assert to_map(matrix(from_euler(0.5, 0, 0)), (0.0, 1.0, 0.0))[2] == pytest.approx(math.sin(0.5))


def test_the_heading_is_that_of_a_pose() -> None:
    assert Pose(0.0, 0.0, 0.0, *from_euler(0.2, 0.3, 1.0)).yaw_rad == pytest.approx(1.0)


@given(VECTORS)
def test_many_small_turns_are_one_large_turn(rates: Vector) -> None:
    small = LEVEL
    for _ in range(50):
        small = turned(small, rates, 0.01)
    large = turned(LEVEL, rates, 0.5)
    assert abs(sum(a * b for a, b in zip(small, large, strict=True))) == pytest.approx(1.0, abs=1e-9)


def test_body_without_turn_keeps_attitude_exactly() -> None:
    q = from_euler(0.1, 0.2, 0.3)
    assert turned(q, (0.0, 0.0, 0.0), 0.01) == pytest.approx(q, abs=1e-15)


@given(ANGLES, VECTORS)
def test_levelling_is_turn_to_map_without_heading(angles: Vector, vector: Vector) -> None:
    roll, pitch, _ = angles
    assert levelled(vector, roll, pitch) == pytest.approx(
        to_map(matrix(from_euler(roll, pitch, 0.0)), vector), abs=1e-9
    )
