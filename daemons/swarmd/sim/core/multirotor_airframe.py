"""Model of a multirotor airframe with drag, and rotors with lag, thrust and torque."""

import math

from swarmd.sim.core.airframe_model import drag_n
from swarmd.sim.core.rigid_body import RigidBody
from swarmware.geometry.attitude import Vector
from swarmware.model.airframe import MultirotorAirframe
from swarmware.types.chassis import ActuatorOutputs


class MultirotorRotors:
    """Fixed-pitch rotors, whose speed follows the output with a lag; thrust and torque grow with its square.

    Source: Mahony, Kumar, Corke 2012, "Multirotor aerial vehicles", IEEE Robotics & Automation Magazine 19.
    """

    __slots__ = ("_airframe", "_arms", "_hover", "_speeds")

    def __init__(self, airframe: MultirotorAirframe) -> None:
        self._airframe = airframe
        self._speeds = [0.0] * len(airframe.rotors)
        """Ratio of each rotor's speed to its maximum."""
        ratio = airframe.motor.torque_ratio_m
        self._arms = tuple((rotor.x_m, rotor.y_m, rotor.torque_sign * ratio) for rotor in airframe.rotors)
        self._hover = airframe.hover_thrust_n / (airframe.motor.thrust_max_n * len(airframe.rotors))

    def loads(
        self, outputs: ActuatorOutputs, body: RigidBody, air_m_s: Vector, dt_s: float
    ) -> tuple[Vector, Vector]:
        """Advances the rotors by a step; returns force and moment in body axes, without gravity."""
        airframe, speeds = self._airframe, self._speeds
        share = 1 - math.exp(-dt_s / airframe.motor.tau_s)
        motors = outputs.motors or (0.0,) * len(speeds)
        thrust_max = airframe.motor.thrust_max_n
        up = roll = pitch = yaw = 0.0
        for index, ((x, y, torque), output) in enumerate(zip(self._arms, motors, strict=False)):
            speeds[index] += (min(max(output, 0.0), 1.0) - speeds[index]) * share
            # thrust and torque grow with the square of the rotor's speed
            thrust = thrust_max * speeds[index] ** 2
            up += thrust
            roll += y * thrust
            pitch -= x * thrust
            yaw += torque * thrust
        drag = drag_n(airframe.body, air_m_s)
        turn, (p, q, r) = airframe.body.turn_drag_n_m_s, body.rates_rad_s
        return (
            (drag[0], drag[1], drag[2] + up),
            (roll - turn[0] * p, pitch - turn[1] * q, yaw - turn[2] * r),
        )

    def power_w(self) -> float:
        """Electric power in W, by momentum theory proportional to thrust^1.5 of each rotor."""
        motor = self._airframe.motor
        mean = sum(speed**3 for speed in self._speeds) / len(self._speeds)
        return motor.idle_w + motor.hover_w * mean / math.pow(self._hover, 1.5)
