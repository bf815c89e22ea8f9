"""Corrections of inertial units from samples at rest: bias, scale, mounting, heading, and refusals."""

import math
import random
from collections.abc import Sequence

import msgspec
import pytest

from swarmd.hal.core.imu_calibration import (
    FACES,
    AccelerometerFaces,
    ImuCorrection,
    ImuCorrector,
    compass,
    gyro,
    level,
)
from swarmware.errors import Denied
from swarmware.geometry.attitude import Vector, from_euler, matrix, to_body
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.vehicle import Imu

NONE = ImuCorrection()
REST = (0.0, 0.0, GRAVITY_M_S2)


def samples(
    rates: Vector = (0.0, 0.0, 0.0), force: Vector = REST, yaw_rad: float | None = None, noise: float = 1.0
) -> list[Imu]:
    """Samples of a unit with the noise of a MEMS chip."""
    chance = random.Random(1)

    def about(vector: Vector, sigma: float) -> Vector:
        x, y, z = (value + chance.gauss(0.0, sigma * noise) for value in vector)
        return x, y, z

    return [
        Imu(
            *about(rates, 0.003),
            *about(force, 0.05),
            None if yaw_rad is None else math.remainder(yaw_rad + chance.gauss(0.0, 0.01), math.tau),
        )
        for _ in range(50)
    ]


def seen(roll_rad: float, pitch_rad: float) -> Vector:
    """Gravity in the axes of a unit that is mounted so in a level vehicle."""
    return to_body(matrix(from_euler(roll_rad, pitch_rad, 0.0)), REST)


def test_the_bias_of_the_gyro_is_subtracted() -> None:
    found = gyro(samples((0.02, -0.01, 0.005)), NONE)
    assert found.gyro_bias_rad_s == pytest.approx((0.02, -0.01, 0.005), abs=0.002)
    right = ImuCorrector(found).apply(Imu(0.52, -0.01, 0.005, *REST))
    assert (right.wx_rad_s, right.wy_rad_s, right.wz_rad_s) == pytest.approx((0.5, 0.0, 0.0), abs=0.002)


@pytest.mark.parametrize(("roll", "pitch"), [(0.1, 0.0), (0.0, -0.2), (-0.15, 0.25)])
def test_oblique_unit_measures_as_if_level(roll: float, pitch: float) -> None:
    found = level(samples(force=seen(roll, pitch)), NONE)
    assert (found.roll_rad, found.pitch_rad) == pytest.approx((roll, pitch), abs=0.005)
    turn = to_body(matrix(from_euler(roll, pitch, 0.0)), (0.3, 0.0, 0.0))
    right = ImuCorrector(found).apply(Imu(*turn, *seen(roll, pitch), 1.0, roll, pitch))
    assert (right.ax_m_s2, right.ay_m_s2, right.az_m_s2) == pytest.approx(REST, abs=0.06)
    assert (right.wx_rad_s, right.wy_rad_s, right.wz_rad_s) == pytest.approx((0.3, 0.0, 0.0), abs=0.003)
    assert (right.roll_rad, right.pitch_rad, right.yaw_rad) == pytest.approx((0.0, 0.0, 1.0), abs=0.005)


def test_gravity_in_six_attitudes_gives_offset_and_scale() -> None:
    offset, scale = (0.3, -0.2, 0.5), (1.02, 0.97, 1.0)
    faces = AccelerometerFaces()
    for axis, sign in FACES:
        true = [0.0, 0.0, 0.0]
        true[axis] = sign * GRAVITY_M_S2
        x, y, z = (value / k + o for value, k, o in zip(true, scale, offset, strict=True))
        assert FACES[axis, sign] in faces.missing
        assert faces.add(samples(force=(x, y, z))) == FACES[axis, sign]
    assert faces.missing == ()
    found = faces.result(NONE)
    assert found.force_offset_m_s2 == pytest.approx(offset, abs=0.03)
    assert found.force_scale == pytest.approx(scale, abs=0.005)
    right = found.force(Imu(0.0, 0.0, 0.0, GRAVITY_M_S2 / 1.02 + 0.3, -0.2, 0.5))
    assert right == pytest.approx((GRAVITY_M_S2, 0.0, 0.0), abs=0.06)


@pytest.mark.parametrize(("measured", "true"), [(0.4, 0.5), (3.1, -3.1)])
def test_the_heading_is_turned_to_the_true_one(measured: float, true: float) -> None:
    found = compass(samples(yaw_rad=measured), NONE, true)
    right = ImuCorrector(found).apply(samples(yaw_rad=measured)[0])
    assert right.yaw_rad is not None
    assert math.remainder(right.yaw_rad - true, math.tau) == pytest.approx(0.0, abs=0.05)


def test_correction_keeps_others_and_empty_changes_nothing() -> None:
    first = gyro(samples((0.02, 0.0, 0.0)), NONE)
    both = level(samples((0.02, 0.0, 0.0), seen(0.1, 0.0)), first)
    assert both.gyro_bias_rad_s == first.gyro_bias_rad_s
    sample = samples()[0]
    assert ImuCorrector().apply(sample) is sample
    assert msgspec.json.decode(msgspec.json.encode(both), type=ImuCorrection) == both


def oblique(taken: Sequence[Imu]) -> None:
    AccelerometerFaces().add(taken)


@pytest.mark.parametrize(
    ("taken", "expected"),
    [
        (lambda: gyro(samples()[:5], NONE), "5 samples of the inertial unit, expected at least 20"),
        (lambda: gyro(samples(noise=30.0), NONE), "the vehicle moved"),
        (lambda: gyro(samples((0.4, 0.0, 0.0)), NONE), "the vehicle turns"),
        (lambda: level(samples(force=seen(0.5, 0.0)), NONE), "stand the vehicle level"),
        (lambda: compass(samples(), NONE, 0.0), "this unit measures no heading"),
        (lambda: oblique(samples(force=seen(0.8, 0.0))), "expected one axis of the vehicle upright"),
    ],
)
def test_what_cannot_be_a_calibration_is_refused(taken: object, expected: str) -> None:
    assert callable(taken)
    with pytest.raises(Denied, match=expected):
        taken()


def test_accelerometer_off_by_tenth_is_refused() -> None:
    faces = AccelerometerFaces()
    for axis, sign in FACES:
        force = [0.0, 0.0, 0.0]
        force[axis] = sign * GRAVITY_M_S2 * 0.88
        faces.add(samples(force=(force[0], force[1], force[2])))
    with pytest.raises(Denied, match=r"expected at most 2, and 1 ± 0\.1"):
        faces.result(NONE)
