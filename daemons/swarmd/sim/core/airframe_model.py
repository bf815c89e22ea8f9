"""Interface of airframe models, which turn actuator outputs into force and moment on the body."""

from typing import Protocol

from swarmd.sim.core.rigid_body import RigidBody
from swarmware.geometry.attitude import Vector
from swarmware.model.body_config import BodyConfig
from swarmware.types.chassis import ActuatorOutputs


class AirframeModel(Protocol):
    """Actuators and aerodynamics of one vehicle."""

    def loads(
        self, outputs: ActuatorOutputs, body: RigidBody, air_m_s: Vector, dt_s: float
    ) -> tuple[Vector, Vector]:
        """Advances the actuators by a step; returns force in N and moment in N m, in body axes, without
        gravity.

        `outputs`: outputs of the flight controller; motors without an output stop. `air_m_s`: velocity of the
        body relative to the air, in body axes.
        """
        ...

    def power_w(self) -> float:
        """Present electric power of motors and electronics."""
        ...


def drag_n(config: BodyConfig, air_m_s: Vector) -> Vector:
    """Drag of the body in body axes, linear and quadratic in the velocity."""
    x, y, z = (
        -(linear + quadratic * abs(speed)) * speed
        for linear, quadratic, speed in zip(config.drag_n_s_m, config.drag_n_s2_m2, air_m_s, strict=True)
    )
    return x, y, z
