"""Vehicles whose driver finds out by itself whether they fly, in virtual time with a simulated body."""

import math

import pytest
from tests.simulation.flight.vehicle import Flight
from tests.simulation.seeds import seeds

from swarmd.hal.config import MotorPulse, ServoPulse
from swarmd.hal.core.flight.flight_core import FlightCore, hover_law
from swarmd.hal.core.flight.flight_state import FlightState
from swarmd.hal.core.flight.motor_phase import FlightSample, MotorPhase, MotorSwitch
from swarmware.model.airframe import MultirotorAirframe
from swarmware.model.helicopter_airframe import HelicopterAirframe
from swarmware.types.chassis import ActuatorOutputs, ChassisAction, ChassisOrder
from swarmware.types.navigation import Goal, GoalKind, NavState
from swarmware.types.vehicle import Setpoint, VehicleState

BOTH = pytest.mark.parametrize("airframe", ["quad_1k5", "hexa_14k", "helicopter"])
MOTOR, SERVO = MotorPulse(channel=0), ServoPulse(channel=0)


class PulsedFlight(Flight):
    """A flight whose body has motors behind pulses of whole microseconds; only the driver arms them."""

    def __init__(self, airframe: str, seed: int) -> None:
        super().__init__(airframe, seed)
        assert isinstance(self.airframe, MultirotorAirframe | HelicopterAirframe)
        self.law = hover_law(self.airframe)
        self.core = FlightCore(self.law)
        self.switch = MotorSwitch()
        self.phases = [MotorPhase.DISARMED]
        """The phases in their order."""
        self.motors: tuple[float, ...] = ()
        """What the motors got last."""
        self.simulation.vehicle.armed = True  # motor controllers follow their pulses at any time

    def carry(self, outputs: ActuatorOutputs, now_ns: int) -> None:
        self.switch.on_step(
            FlightSample(self.core.state(), self.law.lift_ratio, self.setpoint.vz_m_s), now_ns
        )
        self._inform(True, True)
        if self.phases[-1] is not self.switch.phase:
            self.phases.append(self.switch.phase)
        allowed = self.switch.outputs(outputs)
        self.motors = tuple((round(MOTOR.width_us(value)) - 1000) / 1000 for value in allowed.motors)
        servos = tuple((round(SERVO.width_us(value)) - 1500) / 500 for value in allowed.servos)
        super().carry(ActuatorOutputs(self.motors, servos), now_ns)

    def order(self, action: ChassisAction) -> str:
        self.number += 1
        refused = self.switch.on_order(ChassisOrder(self.number, action), self.now_ns).refused
        self._inform(True, True)
        return refused

    def _inform(self, armed: bool, landed: bool) -> None:
        """The state of the simulated body is not used, because no firmware reports it."""
        report = self.switch.report
        self.core.on_vehicle(armed=report.armed, landed=report.landed)
        self.navigator.on_vehicle(VehicleState(report.armed, report.landed))


def risen(airframe: str, seed: int) -> PulsedFlight:
    flight = PulsedFlight(airframe, seed)
    flight.run(2.0)
    assert not flight.order(ChassisAction.ARM)
    flight.goal(Goal(1, GoalKind.TAKEOFF, z_m=3.0))
    flight.run_until(lambda f: f.status.goal_seq == 1 and f.status.state is NavState.ARRIVED, 20.0)
    flight.goal(Goal(2, GoalKind.HOLD))
    return flight


@BOTH
@pytest.mark.parametrize("seed", seeds(1, 4))
def test_vehicle_takes_off_holds_and_lands_by_phases(airframe: str, seed: int) -> None:
    flight = risen(airframe, seed)
    assert flight.phases == [MotorPhase.DISARMED, MotorPhase.GROUNDED, MotorPhase.AIRBORNE]
    places = [flight.truth]
    flight.run(20.0, lambda f: places.append(f.truth))
    assert max(math.dist((p.x_m, p.y_m), (places[0].x_m, places[0].y_m)) for p in places) < 1.0
    for number, height_m in enumerate((8.0, 2.0, 5.0), 3):
        flight.goal(Goal(number, GoalKind.GOTO, x_m=places[0].x_m, y_m=places[0].y_m, z_m=height_m))
        flight.run_until(lambda f: f.status.state is NavState.ARRIVED, 30.0)
        assert "disarming in the air" in flight.order(ChassisAction.DISARM)
    assert flight.phases[-1] is MotorPhase.AIRBORNE, "a descent is not a landing"
    flight.goal(Goal(9, GoalKind.LAND, speed_m_s=1.0))
    flight.run_until(lambda _: flight.switch.phase is MotorPhase.GROUNDED, 30.0)
    assert flight.truth.z_m == 0.0
    assert flight.order(ChassisAction.DISARM) == ""
    flight.run(1.0)
    assert flight.motors == ()
    assert flight.collisions == []


@BOTH
def test_killed_vehicle_arms_again_only_on_ground(airframe: str) -> None:
    flight = risen(airframe, 7)
    assert flight.order(ChassisAction.KILL) == ""
    flight.run(0.02)
    assert flight.motors == ()
    assert "arming in the air" in flight.order(ChassisAction.ARM)
    flight.run_until(lambda _: flight.switch.phase is MotorPhase.DISARMED, 20.0)
    assert flight.truth.z_m == 0.0


def test_grounded_vehicle_stays_until_climb_is_commanded() -> None:
    flight = PulsedFlight("quad_1k5", 3)
    assert "no inertial samples" in flight.order(ChassisAction.ARM)
    flight.run(2.0)
    assert not flight.order(ChassisAction.ARM)
    flight.commands = lambda time_s: Setpoint(0.5, vz_m_s=-0.5)
    flight.run(5.0)
    assert flight.phases == [MotorPhase.DISARMED, MotorPhase.GROUNDED]
    assert flight.order(ChassisAction.DISARM) == ""
    assert "no inertial samples" in flight.switch.on_order(ChassisOrder(9, ChassisAction.ARM), 10**12).refused


def test_motors_stop_after_held_outputs_without_inertial_samples() -> None:
    flight = risen("quad_1k5", 4)
    assert not flight.switch.stop_if_blind(flight.now_ns + 900_000_000)
    assert flight.switch.stop_if_blind(flight.now_ns + 1_100_000_000)
    assert flight.switch.phase is MotorPhase.FALLING
    assert not flight.switch.stop_if_blind(flight.now_ns + 1_400_000_000), "it is said once"
    assert flight.switch.outputs(ActuatorOutputs((0.5,), (0.2,))) == ActuatorOutputs((), (0.2,))


def test_order_runs_once_and_impossible_order_is_refused() -> None:
    switch = MotorSwitch()
    calibrate = switch.on_order(ChassisOrder(5, ChassisAction.CALIBRATE), 0)
    assert "learn the widths of pulses at their power-up" in calibrate.refused
    assert switch.on_order(ChassisOrder(4, ChassisAction.KILL), 0).answered == 5
    assert "not supported by this driver" in switch.on_order(ChassisOrder(6, ChassisAction.GAINS), 0).refused


def test_vehicle_on_its_side_is_not_armed() -> None:
    switch = MotorSwitch()
    lying = FlightState(1.4, 0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    switch.on_step(FlightSample(lying, 0.0, 0.0), 10)
    assert "tilted by 1.40 rad" in switch.on_order(ChassisOrder(1, ChassisAction.ARM), 20).refused
