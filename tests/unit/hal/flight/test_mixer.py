"""The mixer: exact allocation within the rotors' range, and priorities beyond it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.hal.flight.frames import BOTH, airframe

from swarmd.hal.core.flight.mixer import IDLE, Mixer
from swarmware.geometry.attitude import Vector
from swarmware.model.airframe import MultirotorAirframe


def produced(frame: MultirotorAirframe, outputs: tuple[float, ...]) -> tuple[float, Vector]:
    """Thrust and moments of the rotors, from their physics."""
    thrusts = [frame.motor.thrust_max_n * output**2 for output in outputs]
    arms = list(zip(thrusts, frame.rotors, strict=True))
    ratio = frame.motor.torque_ratio_m
    return sum(thrusts), (
        sum(thrust * rotor.y_m for thrust, rotor in arms),
        -sum(thrust * rotor.x_m for thrust, rotor in arms),
        sum(thrust * rotor.torque_sign * ratio for thrust, rotor in arms),
    )


@BOTH
def test_small_moments_at_hover_are_produced_exactly(name: str) -> None:
    frame = airframe(name)
    scale = frame.hover_thrust_n
    moment = (0.01 * scale, -0.012 * scale, 0.003 * scale)
    outputs, exact = Mixer(frame).outputs(scale, moment)
    thrust, found = produced(frame, outputs)
    assert exact
    assert thrust == pytest.approx(scale)
    assert found == pytest.approx(moment)


@BOTH
def test_hover_moments_are_zero_with_unequal_arms(name: str) -> None:
    frame = airframe(name)
    outputs, _ = Mixer(frame).outputs(frame.hover_thrust_n, (0.0, 0.0, 0.0))
    assert produced(frame, outputs)[1] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert max(outputs) < 0.85


@BOTH
def test_yaw_gives_way_to_roll_and_pitch(name: str) -> None:
    frame = airframe(name)
    roll = 0.06 * frame.hover_thrust_n
    outputs, exact = Mixer(frame).outputs(frame.hover_thrust_n, (roll, 0.0, 100.0))
    thrust, found = produced(frame, outputs)
    assert not exact
    assert thrust == pytest.approx(frame.hover_thrust_n)
    assert found[0] == pytest.approx(roll)
    assert 0.0 < found[2] < 100.0


@BOTH
def test_thrust_gives_way_to_roll(name: str) -> None:
    frame = airframe(name)
    full = frame.motor.thrust_max_n * len(frame.rotors)
    roll = 0.05 * full
    outputs, exact = Mixer(frame).outputs(0.99 * full, (roll, 0.0, 0.0))
    thrust, found = produced(frame, outputs)
    assert not exact
    assert thrust < 0.99 * full
    assert found[0] == pytest.approx(roll)


@given(st.floats(-1e4, 1e4), st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)))
def test_no_command_leaves_the_range_of_the_motors(thrust: float, moment: Vector) -> None:
    outputs, _ = Mixer(airframe()).outputs(thrust, moment)
    assert all(IDLE - 1e-9 <= output <= 1.0 for output in outputs)
