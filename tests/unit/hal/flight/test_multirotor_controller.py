"""The controller of a multirotor: on the ground, at lift-off, and when its gains change in flight."""

import pytest
from tests.unit.hal.flight.frames import BOTH, airframe, state

from swarmd.hal.core.flight.hover_controller import MultirotorController
from swarmd.hal.core.flight.mixer import IDLE
from swarmware.errors import Denied
from swarmware.model.airframe import MultirotorAirframe
from swarmware.types.vehicle import Setpoint

STOP, UP = Setpoint(0.0), Setpoint(0.0, 0.0, 0.5)
DT_S = 0.01


def thrust_n(frame: MultirotorAirframe, motors: tuple[float, ...]) -> float:
    return sum(frame.motor.thrust_max_n * output**2 for output in motors)


@BOTH
def test_grounded_rotors_idle_until_climb_is_commanded(name: str) -> None:
    frame = airframe(name)
    controller = MultirotorController(frame)
    assert controller.update(STOP, state(), landed=True, dt_s=DT_S).motors == (IDLE,) * len(frame.rotors)
    lifting = controller.update(UP, state(), landed=True, dt_s=DT_S).motors
    assert thrust_n(frame, lifting) > frame.hover_thrust_n


@BOTH
def test_level_vehicle_gets_thrust_of_its_weight(name: str) -> None:
    frame = airframe(name)
    motors = MultirotorController(frame).update(STOP, state(), landed=False, dt_s=DT_S).motors
    assert thrust_n(frame, motors) == pytest.approx(frame.hover_thrust_n)


def test_tilted_vehicle_gets_more_thrust() -> None:
    frame = airframe()
    controller = MultirotorController(frame)
    level = thrust_n(frame, controller.update(STOP, state(), landed=False, dt_s=DT_S).motors)
    tilted = thrust_n(frame, controller.update(STOP, state(0.3), landed=False, dt_s=DT_S).motors)
    assert tilted == pytest.approx(level / 0.955, rel=0.01)


def test_overturned_vehicle_is_righted_with_thrust_reserve() -> None:
    frame = airframe()
    motors = MultirotorController(frame).update(UP, state(1.5), landed=False, dt_s=DT_S).motors
    left = [output for output, rotor in zip(motors, frame.rotors, strict=True) if rotor.y_m > 0.0]
    right = [output for output, rotor in zip(motors, frame.rotors, strict=True) if rotor.y_m < 0.0]
    assert max(left) < min(right)  # positive roll has lowered the right side


def test_gains_change_in_flight_and_others_stay() -> None:
    controller = MultirotorController(airframe())
    before = controller.gains
    controller.set_gains({"rate_kp_1_s": 9.0})
    assert controller.gains == {**before, "rate_kp_1_s": 9.0}


@pytest.mark.parametrize(
    ("gains", "reason"),
    [
        ({"rate_kp": 1.0}, "gain 'rate_kp': unknown to this airframe; expected one of rate_kp_1_s, "),
        ({"attitude_kp_1_s": 2.0, "rate_kp_1_s": -1.0}, "gains: .* >= 0.0 .*rate_kp_1_s"),
    ],
)
def test_unknown_or_excessive_gains_change_nothing(gains: dict[str, float], reason: str) -> None:
    controller = MultirotorController(airframe())
    before = controller.gains
    with pytest.raises(Denied, match=reason):
        controller.set_gains(gains)
    assert controller.gains == before


def test_commanded_acceleration_is_stated_and_forgotten_on_ground() -> None:
    controller = MultirotorController(airframe())
    controller.update(Setpoint(1.0), state(), landed=False, dt_s=DT_S)
    assert controller.acceleration_m_s2 == pytest.approx(controller.gains["velocity_kp_1_s"], rel=0.02)
    controller.reset()
    assert controller.acceleration_m_s2 == 0.0
