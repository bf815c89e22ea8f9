"""Velocity loop: commands roll and pitch for a horizontal velocity."""

import math

from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.hover_gains import HoverGains, HoverLimits


class VelocityLoop:
    """PI controller of the velocity in the map, limited to the acceleration at the maximum tilt."""

    __slots__ = ("_integral", "acceleration_m_s2")

    def __init__(self) -> None:
        self._integral = (0.0, 0.0)
        """Acceleration to the east and the north against the wind, in the map so that turns do not change
        it."""
        self.acceleration_m_s2 = (0.0, 0.0)
        """Last commanded acceleration to the east and the north, without the integral."""

    def reset(self) -> None:
        """Clears the integral of the velocity error."""
        self._integral = self.acceleration_m_s2 = (0.0, 0.0)

    def tilt_rad(
        self,
        gains: HoverGains,
        limits: HoverLimits,
        wanted_m_s: tuple[float, float],
        state: FlightState,
        dt_s: float,
    ) -> tuple[float, float]:
        """Roll and pitch for a velocity forward and left."""
        cos, sin = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
        forward, left = wanted_m_s
        scale = min(1.0, limits.velocity_max_m_s / max(math.hypot(forward, left), 1e-9))
        error_x = (forward * cos - left * sin) * scale - state.velocity_m_s[0]
        error_y = (forward * sin + left * cos) * scale - state.velocity_m_s[1]
        x = gains.velocity_kp_1_s * error_x + self._integral[0]
        y = gains.velocity_kp_1_s * error_y + self._integral[1]
        size, max_m_s2 = math.hypot(x, y), GRAVITY_M_S2 * math.tan(limits.tilt_max_rad)
        if size <= max_m_s2:  # anti-windup: the integral follows only while the output is not limited
            step = gains.velocity_ki_1_s2 * dt_s
            self._integral = self._integral[0] + error_x * step, self._integral[1] + error_y * step
        else:
            x, y = x * max_m_s2 / size, y * max_m_s2 / size
        self.acceleration_m_s2 = x - self._integral[0], y - self._integral[1]
        ahead, aside = x * cos + y * sin, y * cos - x * sin
        return math.atan2(-aside, math.hypot(ahead, GRAVITY_M_S2)), math.atan2(ahead, GRAVITY_M_S2)
