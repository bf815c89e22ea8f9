"""Model of a helicopter airframe: a linear hover model with nonlinear thrust, drag and rotor speed."""

import math
from typing import Final

from swarmd.sim.core.airframe_model import drag_n
from swarmd.sim.core.helicopter_dynamics import HoverDynamics
from swarmd.sim.core.main_rotor import MainRotor
from swarmd.sim.core.rigid_body import RigidBody
from swarmware.geometry.attitude import Vector
from swarmware.model.helicopter_airframe import HelicopterAirframe
from swarmware.types.chassis import ActuatorOutputs

_STANDS: Final = 0.05
"""Ratio of the rotor's speed to the governor's speed below which the disc does not tilt."""
_SERVOS: Final = 4


class HelicopterRotors:
    """Main rotor, tail rotor and fuselage of a helicopter.

    Outputs: one motor, whose governor keeps the rotor's speed while the output is above one half; servos of
    lateral and longitudinal cyclic, collective and pedal, positive for roll to the right, nose down, climb
    and nose to the left.
    """

    __slots__ = ("_airframe", "_dynamics", "_rotor", "_servos", "_speed")

    def __init__(self, airframe: HelicopterAirframe) -> None:
        self._airframe = airframe
        self._rotor = MainRotor(airframe.rotor)
        self._dynamics = HoverDynamics(airframe.derivatives)
        self._servos = [0.0, 0.0, -1.0, 0.0]
        self._speed = 0.0
        """Ratio of the rotor's speed to the governor's speed."""

    def loads(
        self, outputs: ActuatorOutputs, body: RigidBody, air_m_s: Vector, dt_s: float
    ) -> tuple[Vector, Vector]:
        """Advances servos and rotors by a step; returns force and moment in body axes, without gravity."""
        airframe = self._airframe
        lateral, longitudinal, collective, pedal = self._actuate(outputs, dt_s)
        of, ratio = airframe.derivatives, self._speed
        u, left, up = air_m_s
        p, nose_down, to_left = body.rates_rad_s
        # the derivatives are defined in axes forward, right, down
        v, w, q, r = -left, -up, -nose_down, -to_left
        thrust = self._rotor.step(collective, math.hypot(u, v), up, body.position_m[2], ratio)
        dynamics = self._dynamics
        if ratio < _STANDS:
            dynamics.stop()
        else:
            dynamics.flap(lateral, longitudinal, (p, q, r), dt_s)
        roll, pitch, yaw = dynamics.angular((u, v, w), (p, q, r), collective, -pedal)
        # all these forces come from the rotors, and fall with the square of their speed
        power = ratio * ratio
        mass, inertia = airframe.body.mass_kg, airframe.body.inertia_kg_m2
        drag = drag_n(airframe.body, air_m_s)
        force = (
            drag[0] + mass * of.x_u * u * power - thrust * dynamics.longitudinal_rad,
            drag[1] + mass * of.y_v * left * power - thrust * dynamics.lateral_rad,
            drag[2] + thrust,
        )
        moment = (inertia[0] * roll * power, -inertia[1] * pitch * power, -inertia[2] * yaw * power)
        return force, moment

    def _actuate(self, outputs: ActuatorOutputs, dt_s: float) -> tuple[float, float, float, float]:
        """Moves servos and governor; returns the positions of lateral, longitudinal, collective and pedal."""
        airframe = self._airframe
        share = 1 - math.exp(-dt_s / airframe.servo_s)
        wanted = outputs.servos if len(outputs.servos) == _SERVOS else (0.0, 0.0, -1.0, 0.0)
        servos = self._servos
        for index, position in enumerate(wanted):
            servos[index] += (min(max(position, -1.0), 1.0) - servos[index]) * share
        # the motor controller has a governor, so the output only switches it
        governed = bool(outputs.motors) and outputs.motors[0] > 0.5
        self._speed += (float(governed) - self._speed) * (1 - math.exp(-dt_s / airframe.rotor.spool_s))
        return servos[0], servos[1], servos[2], servos[3]

    def power_w(self) -> float:
        """Electric power in W, the rotor's power divided by the efficiency of the drive."""
        airframe = self._airframe
        return airframe.idle_w + self._rotor.power_w / airframe.efficiency_ratio
