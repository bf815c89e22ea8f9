"""Model of a vehicle flown by a flight controller: a rigid body with actuators, wind and ground."""

import math
from collections.abc import Callable
from typing import Final

from swarmd.sim.core.airframe_model import AirframeModel
from swarmd.sim.core.rigid_body import RigidBody
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.body_config import BodyConfig
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Pose

_STEP_S: Final = 0.0025
"""Maximum integration step, a tenth of the fastest time constant, which small motors have."""
_TIPPED: Final = math.cos(math.radians(45))
"""Cosine of the tilt of 45°, above which a vehicle that touches the ground falls over."""

Wind = Callable[[float], Vector]
"""Function that advances the wind by a duration in s, and returns its velocity in the map."""


class FlyingBody:
    """Model of a vehicle that is not stable without control.

    The vehicle stays on the ground until its lift exceeds its weight; after a touch-down it slides to rest.
    """

    __slots__ = ("_body", "_config", "_model", "_wind", "armed", "landed")

    flies = True
    safe: Final = ActuatorOutputs()
    stall_s: Final = 2.5

    def __init__(self, model: AirframeModel, config: BodyConfig, start: Pose, wind: Wind) -> None:
        self._model = model
        self._config = config
        self._wind = wind
        place = (start.x_m, start.y_m, max(0.0, start.z_m))
        self._body = RigidBody(config.mass_kg, config.inertia_kg_m2, place, start.yaw_rad)
        self.armed = False
        self.landed = place[2] <= 0.0
        if self.landed:
            self._body.stand(config.rest_pitch_rad)

    @property
    def radius_m(self) -> float:
        """Radius of the sphere around the vehicle."""
        return self._config.radius_m

    def step(self, outputs: ActuatorOutputs, dt_s: float) -> float:
        """Simulates one sample; returns the speed of an impact on the ground, else 0."""
        if not self.armed:
            outputs = self.safe
        wind = self._wind(dt_s)
        # the small subtraction keeps a rounding error from adding a step
        count = math.ceil(dt_s / _STEP_S - 1e-9)
        impact_m_s = 0.0
        for _ in range(count):
            impact_m_s = max(impact_m_s, self._substep(outputs, wind, dt_s / count))
        return impact_m_s

    def _substep(self, outputs: ActuatorOutputs, wind: Vector, dt_s: float) -> float:
        body = self._body
        vx, vy, vz = body.velocity_m_s
        air = body.to_body((vx - wind[0], vy - wind[1], vz - wind[2]))
        force, moment = self._model.loads(outputs, body, air, dt_s)
        if self.landed:
            # the ground carries the vehicle until the lift exceeds the weight
            if body.to_map(force)[2] <= body.mass_kg * GRAVITY_M_S2:
                self._slide(dt_s)
                return 0.0
            self.landed = False
        body.step(force, moment, dt_s)
        if body.position_m[2] <= 0.0 and body.velocity_m_s[2] <= 0.0:
            return self._touch_down()
        return 0.0

    def _touch_down(self) -> float:
        body = self._body
        # read before the body is put upright, which changes all three
        speed_m_s, sink_m_s, tipped = math.hypot(*body.velocity_m_s), -body.velocity_m_s[2], body.up < _TIPPED
        body.stand(0.0)
        self.landed = True
        if self._config.slide_m_s2 == 0.0:
            self._come_to_rest()
        return speed_m_s if tipped or sink_m_s > self._config.hard_landing_m_s else 0.0

    def _slide(self, dt_s: float) -> None:
        """Brakes a landed vehicle that is still moving."""
        body = self._body
        speed = math.hypot(*body.velocity_m_s)
        if speed == 0.0:
            return
        after = speed - self._config.slide_m_s2 * dt_s
        if after > 0.0:
            body.slide(after, dt_s)
        else:
            self._come_to_rest()

    def _come_to_rest(self) -> None:
        body = self._body
        body.rest(body.position_m)
        body.stand(self._config.rest_pitch_rad)

    def stop_at(self, x_m: float, y_m: float, z_m: float) -> None:
        """Stops the vehicle at an obstacle that it hit."""
        self._body.rest((x_m, y_m, z_m))

    def pose(self) -> Pose:
        """The true pose of the vehicle."""
        body = self._body
        return Pose(*body.position_m, *body.attitude, *body.velocity_m_s, body.to_map(body.rates_rad_s)[2])

    def rates(self) -> Vector:
        """Rates about the body axes."""
        return self._body.rates_rad_s

    def specific_force(self) -> Vector:
        """Specific force, which an accelerometer measures, in body axes."""
        return self._body.specific_force_m_s2

    def power_w(self) -> float:
        """Electric power in W."""
        return self._model.power_w()
