"""The core of flight control: outputs of control steps, and the conditions under which there are none."""

import msgspec
import pytest
from tests.unit.hal.flight.frames import airframe

from swarmd.hal.core.flight.flight_core import FlightCore, FlightHandover, FlightTiming
from swarmd.hal.core.flight.hover_controller import MultirotorController
from swarmd.hal.core.flight.mixer import IDLE
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import GnssFix, Imu, Setpoint

MS = 1_000_000
STILL = Imu(0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY_M_S2, 0.0)


def core() -> FlightCore:
    made = FlightCore(MultirotorController(airframe()))
    made.on_imu(STILL, 10 * MS)
    return made


def test_each_inertial_sample_is_one_control_step() -> None:
    flight = core()
    assert flight.step(12 * MS) == ActuatorOutputs()
    assert flight.step(13 * MS) is None
    flight.on_imu(STILL, 10 * MS)  # the same again
    assert flight.step(14 * MS) is None
    flight.on_imu(STILL, 20 * MS)
    assert flight.step(22 * MS) is not None


def test_disarmed_vehicle_is_silent_and_armed_idles() -> None:
    flight = core()
    flight.on_setpoint(Setpoint(0.0, 0.0, 1.0))
    assert flight.step(10 * MS) == ActuatorOutputs()
    flight.on_vehicle(armed=True, landed=True)
    flight.on_setpoint(Setpoint(0.0))
    flight.on_imu(STILL, 20 * MS)
    outputs = flight.step(20 * MS)
    assert outputs is not None
    assert outputs.motors == (IDLE,) * 4


def test_without_inertial_samples_nothing_is_commanded() -> None:
    flight = core()
    flight.on_vehicle(armed=True, landed=False)
    assert not flight.is_blind(200 * MS)
    assert flight.is_blind(211 * MS)
    assert flight.step(211 * MS) is None


def test_disarmed_vehicle_forgets_learnt_loop_state() -> None:
    flight = core()
    flight.on_gnss(GnssFix(48.0, 11.0, 500.0, 0.03, 12), 5 * MS, 10 * MS)
    flight.on_setpoint(Setpoint(0.0, 0.0, 2.0))
    flight.on_vehicle(armed=True, landed=False)
    first = flight.step(10 * MS)
    for tick in range(2, 200):
        flight.on_imu(STILL, tick * 10 * MS)
        flight.step(tick * 10 * MS)
    flight.on_vehicle(armed=False, landed=True)
    flight.on_imu(STILL, 2010 * MS)
    flight.step(2010 * MS)
    flight.on_vehicle(armed=True, landed=False)
    flight.on_imu(STILL, 2020 * MS)
    again = flight.step(2020 * MS)
    assert first is not None
    assert again is not None
    assert abs(first.motors[0] - again.motors[0]) < 0.02


def test_mean_of_samples_is_taken_with_attitude() -> None:
    flight = core()
    flight.on_imu(Imu(0.2, 0.0, 0.0, 0.0, 0.0, GRAVITY_M_S2, 0.0), 20 * MS)
    mean = flight.take_imu()
    assert mean is not None
    assert mean.wx_rad_s == 0.1
    assert mean.roll_rad is not None
    assert mean.roll_rad > 0.0
    assert flight.take_imu() is None


def flying() -> FlightCore:
    """A core in flight with a constant roll acceleration."""
    flight = core()
    flight.on_vehicle(armed=True, landed=False)
    for tick in range(2, 11):
        flight.on_imu(STILL, tick * 10 * MS)
        flight.step(tick * 10 * MS)
    return flight


def test_gap_is_computed_from_samples_at_ends() -> None:
    flight = flying()
    after = msgspec.structs.replace(STILL, wx_rad_s=0.8)
    flight.on_imu(after, 600 * MS)
    assert flight.step(600 * MS) is not None
    assert flight.state().roll_rad == pytest.approx(0.8 / 2 * 0.5, abs=0.01)
    assert flight.state().rates_rad_s[0] == pytest.approx(0.8, abs=0.01)
    assert not flight.lost


def test_vehicle_with_stopped_motors_keeps_its_rate() -> None:
    flight = flying()
    falling = Imu(0.4, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0)
    flight.on_imu(falling, 1600 * MS)
    assert flight.state().roll_rad == pytest.approx(0.4 / 2 + 0.4 * 0.5, abs=0.02)
    outputs = flight.step(1600 * MS)
    assert outputs is not None
    assert min(outputs.motors) > 0.0, "it is caught"


@pytest.mark.parametrize(
    ("after", "gap_ms", "reason"),
    [
        (STILL, 1500, "the vehicle does not fall: 9.8 m/s² on it"),
        (Imu(1.5, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0), 1600, "a tilt of 9"),
        (Imu(0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0), 2100, "2.10 s without a step, expected at most 2 s"),
        (STILL, 1200, ""),
        (STILL, 900, ""),
    ],
)
def test_flight_with_stopped_motors_continues_only_safely(after: Imu, gap_ms: int, reason: str) -> None:
    flight = flying()
    flight.on_imu(after, (100 + gap_ms) * MS)
    outputs = flight.step((100 + gap_ms) * MS)
    assert outputs is not None
    assert (outputs == ActuatorOutputs()) is bool(reason)
    assert reason in flight.lost if reason else not flight.lost
    flight.on_vehicle(armed=False, landed=False)
    assert not flight.lost


def test_output_hold_time_is_set_by_airframe() -> None:
    flight = FlightCore(MultirotorController(airframe()), FlightTiming(0.01, 0.3))
    flight.on_imu(STILL, 10 * MS)
    flight.on_vehicle(armed=True, landed=False)
    flight.on_imu(STILL, 700 * MS)
    assert "does not fall" in flight.lost


def test_vehicle_stays_grounded_after_unexpected_contact() -> None:
    flight = flying()
    flight.on_setpoint(Setpoint(0.0, 0.0, 1.0))
    for tick in range(11, 130):
        flight.on_imu(STILL, tick * 10 * MS)
        flight.step(tick * 10 * MS)

    def motors(ms: int) -> float:
        flight.on_imu(STILL, ms * MS)
        outputs = flight.step(ms * MS)
        assert outputs is not None
        return outputs.motors[0] if outputs.motors else 0.0

    flight.on_vehicle(armed=True, landed=True)
    assert [motors(1300), motors(1310)] == [IDLE, IDLE]
    flight.on_vehicle(armed=False, landed=True)
    assert motors(1320) == 0.0
    flight.on_vehicle(armed=True, landed=True)
    assert motors(1330) > IDLE


def test_flight_of_another_process_continues_with_motion() -> None:
    flight = FlightCore(MultirotorController(airframe()))
    handover = FlightHandover(
        msgspec.structs.replace(STILL, roll_rad=0.2, pitch_rad=-0.1), 100 * MS, 5.0, (1.0, 2.0, 0.0)
    )
    flight.on_handover(handover)
    flight.on_imu(STILL, 500 * MS)
    flight.on_gnss(GnssFix(48.0, 11.0, 500.0, 0.03, 12), 490 * MS, 500 * MS)
    state = flight.state()
    assert (state.roll_rad, state.pitch_rad) == pytest.approx((0.2, -0.1), abs=0.01)
    assert state.position_m[2] == pytest.approx(5.0)
    assert state.velocity_m_s == pytest.approx((1.0, 2.0, 0.0))
    outputs = flight.step(505 * MS)
    assert outputs is not None
    assert min(outputs.motors) > IDLE
