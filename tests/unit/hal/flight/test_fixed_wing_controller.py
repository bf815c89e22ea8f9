"""The controller of a fixed wing: course, airspeed, climb, the bounds of the stall, launch and flare."""

import math

import pytest
from tests.unit.airframes import aerosonde

from swarmd.hal.core.flight.fixed_wing_controller import FixedWingController
from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.errors import Denied
from swarmware.geometry.attitude import Vector
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Setpoint

DT = 0.01


AIRFRAME = aerosonde()
LIMITS = AIRFRAME.limits
CRUISE = LIMITS.airspeed_cruise_m_s
AHEAD = Setpoint(CRUISE)


def fly(
    wanted: Setpoint = AHEAD,
    speed: float = CRUISE,
    climb: float = 0.0,
    height: float = 50.0,
    roll: float = 0.0,
    pitch: float = -0.08,
    rates: Vector = (0.0, 0.0, 0.0),
    landed: bool = False,
) -> ActuatorOutputs:
    """Outputs for a flight to the east, where a negative pitch has the nose up."""
    state = FlightState(roll, pitch, 0.0, rates, (0.0, 0.0, height), (speed, 0.0, climb))
    return FixedWingController(AIRFRAME).update(wanted, state, landed=landed, dt_s=DT)


def aileron(outputs: ActuatorOutputs) -> float:
    return outputs.servos[0]


def elevator(outputs: ActuatorOutputs) -> float:
    return outputs.servos[1]


def throttle(outputs: ActuatorOutputs) -> float:
    return outputs.motors[0]


def test_cruise_throttle_and_elevator_are_trim() -> None:
    outputs = fly()
    assert throttle(outputs) == pytest.approx(LIMITS.throttle_cruise_ratio)
    assert aileron(outputs) == 0.0
    assert -0.6 < elevator(outputs) < -0.2


@pytest.mark.parametrize(
    ("wanted", "right"),
    [
        (Setpoint(CRUISE, 5.0), False),
        (Setpoint(CRUISE, -5.0), True),
        (Setpoint(-CRUISE, -1.0), True),
        (Setpoint(CRUISE, 0.0, 0.0, 0.2), False),
        (Setpoint(0.0), False),
    ],
    ids=["left", "right", "behind to the right", "rate to the left", "loiter to the left"],
)
def test_it_banks_towards_the_commanded_course(wanted: Setpoint, right: bool) -> None:
    assert (aileron(fly(wanted)) > 0.05) is right
    assert (aileron(fly(wanted)) < -0.05) is not right


def test_bank_is_limited_and_smaller_when_slow() -> None:
    steep = Setpoint(0.01 - CRUISE, 0.5)
    held = fly(steep, roll=-LIMITS.bank_max_rad)
    assert abs(aileron(held)) < 0.01
    slow = fly(steep, speed=LIMITS.airspeed_min_m_s, roll=-LIMITS.bank_max_rad)
    assert aileron(slow) > 0.03, "a bank of the maximum would stall it: it rolls back"


def test_bank_of_loiter_is_that_of_its_radius() -> None:
    bank = math.atan(CRUISE**2 / (9.80665 * LIMITS.loiter_radius_m))
    assert abs(aileron(fly(Setpoint(0.0), roll=-bank))) < 0.01


def test_throttle_opens_when_slow_closes_when_fast() -> None:
    assert throttle(fly(speed=CRUISE - 2)) > throttle(fly()) > throttle(fly(speed=CRUISE + 2))
    assert throttle(fly(Setpoint(100.0))) == throttle(fly(Setpoint(LIMITS.airspeed_max_m_s)))
    assert throttle(fly(Setpoint(1.0))) == throttle(fly(Setpoint(LIMITS.airspeed_min_m_s)))


def test_a_climb_raises_the_nose_and_adds_throttle() -> None:
    up, level, down = (fly(Setpoint(CRUISE, 0.0, climb)) for climb in (2.0, 0.0, -2.0))
    assert elevator(up) < elevator(level) < elevator(down)
    assert throttle(up) > throttle(level) > throttle(down)


def test_nose_drops_near_stall_despite_climb() -> None:
    climbing = Setpoint(CRUISE, 0.0, 3.0)
    nose_up = -0.2
    fast = elevator(fly(climbing, pitch=nose_up))
    slow = elevator(fly(climbing, speed=LIMITS.airspeed_min_m_s - 3, pitch=nose_up))
    trimmed = elevator(fly(speed=LIMITS.airspeed_min_m_s - 3))
    assert slow > trimmed, "it pushes"
    assert slow > fast
    assert throttle(fly(climbing, speed=LIMITS.airspeed_min_m_s - 3)) == 1.0


def test_surfaces_act_against_roll_pitch_and_their_rates() -> None:
    assert aileron(fly(roll=0.1)) < 0.0 < aileron(fly(roll=-0.1))
    assert aileron(fly(rates=(0.5, 0.0, 0.0))) < 0.0
    assert elevator(fly(pitch=0.1)) < elevator(fly()) < elevator(fly(pitch=-0.3))
    assert elevator(fly(rates=(0.0, 0.5, 0.0))) < elevator(fly())
    assert fly(rates=(0.0, 0.0, 0.2)).servos[2] < 0.0


def test_deflections_shrink_with_the_square_of_the_airspeed() -> None:
    slow, fast = (aileron(fly(Setpoint(speed), speed=speed, roll=0.1)) for speed in (CRUISE, 28.0))
    assert slow / fast == pytest.approx((28.0 / CRUISE) ** 2)


def test_grounded_aircraft_launches_by_commanded_climb_only() -> None:
    assert fly(Setpoint(CRUISE), speed=0.0, landed=True).motors == (0.0,)
    assert fly(Setpoint(0.0, 0.0, 1.0), speed=0.0, landed=True).motors == (1.0,)


@pytest.mark.parametrize(("climb", "height"), [(2.0, 4.0), (-1.0, 2.0)], ids=["climb-out", "flare"])
def test_near_the_ground_the_wings_stay_level(climb: float, height: float) -> None:
    hard_left = Setpoint(0.1, CRUISE, climb)
    assert aileron(fly(hard_left, height=height, roll=-0.1)) == pytest.approx(0.0, abs=0.01)
    assert aileron(fly(hard_left, height=50.0, roll=-0.1)) < -0.1


def test_flare_closes_throttle_and_raises_nose() -> None:
    sinking = Setpoint(CRUISE, 0.0, -2.0)
    above, below = (fly(sinking, climb=-2.0, height=h) for h in (LIMITS.flare_m + 1, LIMITS.flare_m - 1))
    assert throttle(above) > 0.0 and throttle(below) == 0.0
    assert elevator(below) < elevator(above)


def test_outputs_stay_within_their_ranges_in_any_state() -> None:
    for speed in (0.0, 5.0, 60.0):
        for roll in (-3.0, 1.5, 3.0):
            found = fly(Setpoint(-CRUISE, 3.0, 9.0, 3.0), speed=speed, roll=roll, rates=(9.0, -9.0, 9.0))
            assert 0.0 <= throttle(found) <= 1.0
            assert all(-1.0 <= value <= 1.0 for value in found.servos)


def test_gains_change_and_foreign_ones_are_refused() -> None:
    controller = FixedWingController(AIRFRAME)
    controller.set_gains({"roll_kp": 2.5})
    assert controller.gains["roll_kp"] == 2.5
    with pytest.raises(Denied, match=r"'rate_kp_1_s'.*expected one of roll_kp"):
        controller.set_gains({"rate_kp_1_s": 1.0})
