"""The core of flight control: when it computes outputs, and when it must not."""

from tests.unit.hal.flight.frames import airframe

from swarmd.hal.core.flight.flight_core import FlightCore
from swarmd.hal.core.flight.mixer import IDLE
from swarmd.hal.core.flight.multirotor_controller import MultirotorController
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


def test_a_disarmed_vehicle_gets_no_outputs_and_an_armed_one_on_the_ground_idles() -> None:
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


def test_a_vehicle_that_was_disarmed_forgets_what_its_loops_had_learnt() -> None:
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


def test_the_mean_of_the_samples_is_taken_with_the_attitude() -> None:
    flight = core()
    flight.on_imu(Imu(0.2, 0.0, 0.0, 0.0, 0.0, GRAVITY_M_S2, 0.0), 20 * MS)
    mean = flight.take_imu()
    assert mean is not None
    assert mean.wx_rad_s == 0.1
    assert mean.roll_rad is not None
    assert mean.roll_rad > 0.0
    assert flight.take_imu() is None
