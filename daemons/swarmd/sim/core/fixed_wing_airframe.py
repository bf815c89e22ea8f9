"""Model of a fixed-wing airframe with wing, control surfaces and propeller, launched by a catapult."""

import math
from typing import Final

from swarmd.sim.core.aerodynamics import Deflections, air_loads, propeller
from swarmd.sim.core.rigid_body import RigidBody
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.types.chassis import ActuatorOutputs

_SERVOS: Final = 3


class FixedWing:
    """Wing, tail and propeller of an aircraft.

    Outputs: one motor, which is the throttle; servos of aileron, elevator and rudder, positive for right wing
    down, nose down and nose to the left.
    """

    __slots__ = ("_airframe", "_electric_w", "_rail_m", "_servos", "_throttle")

    def __init__(self, airframe: FixedWingAirframe) -> None:
        self._airframe = airframe
        self._servos = [0.0, 0.0, 0.0]
        self._throttle = 0.0
        self._electric_w = 0.0
        self._rail_m: float | None = None
        """Distance travelled on the rail of the catapult, or None before and after the launch."""

    def loads(
        self, outputs: ActuatorOutputs, body: RigidBody, air_m_s: Vector, dt_s: float
    ) -> tuple[Vector, Vector]:
        """Advances servos and motor by a step; returns force and moment in body axes, without gravity."""
        airframe, surfaces = self._airframe, self._airframe.surfaces
        # exact discretisation of a first-order lag, stable for any step
        share = 1 - math.exp(-dt_s / surfaces.servo_s)
        wanted = outputs.servos if len(outputs.servos) == _SERVOS else (0.0, 0.0, 0.0)
        servos = self._servos
        for index, position in enumerate(wanted):
            servos[index] += (min(max(position, -1.0), 1.0) - servos[index]) * share
        motor = min(max(outputs.motors[0], 0.0), 1.0) if outputs.motors else 0.0
        self._throttle += (motor - self._throttle) * (1 - math.exp(-dt_s / airframe.propeller.lag_s))
        u, left, up = air_m_s
        thrust, torque, self._electric_w = propeller(airframe.propeller, self._throttle, u)
        p, nose_down, to_left = body.rates_rad_s
        deflections = Deflections(
            servos[0] * surfaces.aileron_max_rad,
            servos[1] * surfaces.elevator_max_rad,
            servos[2] * surfaces.rudder_max_rad,
        )
        # the coefficients are defined in axes forward, right, down
        force, moment = air_loads(
            airframe.wing, airframe.lateral, (u, -left, -up), (p, -nose_down, -to_left), deflections
        )
        on_rail = self._on_rail(motor, body, thrust, dt_s)
        if on_rail is not None:
            return on_rail, (0.0, 0.0, 0.0)
        return (
            (force[0] + thrust, -force[1], -force[2]),
            (moment[0] - torque, -moment[1], -moment[2]),
        )

    def _on_rail(self, motor: float, body: RigidBody, thrust_n: float, dt_s: float) -> Vector | None:
        """Force of the catapult, which also carries the aircraft, or None at rest and in the air."""
        launcher = self._airframe.launcher
        if self._rail_m is None:
            speed = math.hypot(*body.velocity_m_s)
            if motor < launcher.throttle_ratio or body.position_m[2] > 0.0 or speed > 0.0:
                return None
            self._rail_m = 0.0
        self._rail_m += math.hypot(*body.velocity_m_s) * dt_s
        if self._rail_m >= launcher.rail_m:
            self._rail_m = None
            return None
        # constant acceleration that reaches the launch speed at the end of the rail
        pull = launcher.speed_m_s**2 / (2 * launcher.rail_m)
        # the pull acts along the rail, the weight of the aircraft across it
        gravity = body.to_body((0.0, 0.0, GRAVITY_M_S2))
        mass = body.mass_kg
        return mass * (pull + gravity[0]), mass * gravity[1], mass * gravity[2]

    def power_w(self) -> float:
        """Present electric power of motor and electronics, in W."""
        return self._airframe.idle_w + self._electric_w
