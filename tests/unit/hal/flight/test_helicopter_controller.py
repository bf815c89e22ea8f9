"""The controller of a helicopter: which way its servos move, feed-forward of the disc, limits, gains."""

import math

import pytest
from tests.unit.airframes import artis

from swarmd.hal.core.flight.flight_state import FlightState
from swarmd.hal.core.flight.helicopter_controller import HelicopterController
from swarmware.errors import Denied
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.vehicle import Setpoint

DT = 0.01
STILL = (0.0, 0.0, 0.0)
HOVER, UP = Setpoint(0.0), Setpoint(0.0, 0.0, 1.0)


AIRFRAME = artis()


def servos(
    wanted: Setpoint = HOVER,
    roll: float = 0.0,
    pitch: float = 0.0,
    rates: Vector = STILL,
    velocity: Vector = STILL,
    yaw: float = 0.0,
) -> tuple[float, ...]:
    state = FlightState(roll, pitch, yaw, rates, (0.0, 0.0, 5.0), velocity)
    return HelicopterController(AIRFRAME).update(wanted, state, landed=False, dt_s=DT).servos


def test_level_rotor_carries_weight_without_turning() -> None:
    lateral, longitudinal, collective, pedal = servos()
    assert collective == pytest.approx(AIRFRAME.collective(AIRFRAME.body.mass_kg * GRAVITY_M_S2))
    assert (lateral, longitudinal) == pytest.approx((0.0, 0.0))
    assert abs(pedal) < 0.05


@pytest.mark.parametrize(
    ("servo", "less", "more"),
    [
        (0, {"roll": 0.2}, {"roll": -0.2}),
        (0, {"rates": (0.5, 0.0, 0.0)}, {"rates": (-0.5, 0.0, 0.0)}),
        (1, {"pitch": 0.2}, {"pitch": -0.2}),
        (1, {"rates": (0.0, 0.5, 0.0)}, {"rates": (0.0, -0.5, 0.0)}),
        (1, {"velocity": (1.0, 0.0, 0.0)}, {"velocity": (-1.0, 0.0, 0.0)}),
        (0, {"velocity": (0.0, -1.0, 0.0)}, {"velocity": (0.0, 1.0, 0.0)}),
        (1, {"velocity": (0.0, 1.0, 0.0), "yaw": 1.5708}, {"velocity": (0.0, -1.0, 0.0), "yaw": 1.5708}),
        (2, {"velocity": (0.0, 0.0, 1.0)}, {"velocity": (0.0, 0.0, -1.0)}),
        (3, {"rates": (0.0, 0.0, 0.5)}, {"rates": (0.0, 0.0, -0.5)}),
        (3, {"wanted": Setpoint(0.0, 0.0, 0.0, -0.5)}, {"wanted": Setpoint(0.0, 0.0, 0.0, 0.5)}),
        (1, {"wanted": Setpoint(-2.0)}, {"wanted": Setpoint(2.0)}),
        (0, {"wanted": Setpoint(0.0, 2.0)}, {"wanted": Setpoint(0.0, -2.0)}),
    ],
)
def test_servos_act_against_errors_about_their_own_axis(
    servo: int, less: dict[str, object], more: dict[str, object]
) -> None:
    low, high = servos(**less)[servo], servos(**more)[servo]  # type: ignore[arg-type]  # by the table
    assert low < servos()[servo] < high


def test_commanded_roll_causes_no_pitch() -> None:
    """Both controls move, so that the disc, once settled, tilts to the side only."""
    of = AIRFRAME.derivatives
    lateral, longitudinal, *_ = servos(roll=-0.1)
    b = a = 0.0
    for _ in range(200):  # the flapping angles at rest
        a = of.a_b * b + of.a_lat * lateral + of.a_lon * longitudinal
        b = of.b_a * a + of.b_lat * lateral + of.b_lon * longitudinal
    assert abs(longitudinal) > 0.01
    # the commanded rate adds a tilt about its own axis, none about the other
    assert abs(a) < 0.2 * abs(b)


def test_climb_collective_exceeds_hover_and_is_bounded() -> None:
    assert servos()[2] < servos(UP)[2] <= 1.0
    assert servos(Setpoint(0.0, 0.0, 50.0), velocity=(0.0, 0.0, -30.0))[2] <= 1.0


def test_grounded_rotor_turns_flat_until_climb() -> None:
    controller = HelicopterController(AIRFRAME)
    ground = FlightState(0.0, 0.0, 0.0, STILL, STILL, STILL)
    waiting = controller.update(Setpoint(3.0), ground, landed=True, dt_s=DT)
    assert waiting.motors == (1.0,) and waiting.servos[2] < -0.5
    assert controller.update(UP, ground, landed=True, dt_s=DT).servos[2] > 0.0


def test_outputs_stay_within_the_servos_in_any_state() -> None:
    for roll in (-3.0, 0.5, 3.0):
        for rate in (-10.0, 10.0):
            found = servos(UP, roll=roll, pitch=-roll / 2, rates=(rate, -rate, rate))
            assert all(-1.0 <= value <= 1.0 and math.isfinite(value) for value in found)


def test_gains_change_in_flight_and_unknown_are_refused() -> None:
    controller = HelicopterController(AIRFRAME)
    controller.set_gains({"attitude_kp_1_s": 2.0})
    assert controller.gains["attitude_kp_1_s"] == 2.0
    assert controller.gains["rate_kp_1_s"] == AIRFRAME.gains.rate_kp_1_s
    with pytest.raises(Denied, match=r"'roll_kp'.*expected one of rate_kp_1_s"):
        controller.set_gains({"roll_kp": 1.0, "attitude_kp_1_s": 9.0})
    with pytest.raises(Denied, match="attitude_kp_1_s"):
        controller.set_gains({"attitude_kp_1_s": -1.0})
    assert controller.gains["attitude_kp_1_s"] == 2.0
