"""Model of a level multirotor with first-order response to velocity set-points, take-off and landing."""

import math
from typing import Final

from swarmd.sim.config import MultirotorLimits
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.vehicle import Pose, Setpoint

_LIFT_M_S: Final = 0.1
"""Commanded climb rate above which a landed vehicle takes off."""
_IDLE: Final = 0.1
"""Ratio of the power on the ground, for electronics and idling motors, to the power in hover."""


class Multirotor:
    """Model of a multirotor that includes its attitude control."""

    __slots__ = ("_accel", "_limits", "_v", "_w", "_x", "_yaw", "armed", "landed")

    flies = True
    safe: Final = Setpoint(0.0)
    stall_s: Final = 1.0

    def __init__(self, limits: MultirotorLimits, start: Pose) -> None:
        self._limits = limits
        self._x = [start.x_m, start.y_m, max(0.0, start.z_m)]
        self._v = [0.0, 0.0, 0.0]
        self._accel = (0.0, 0.0, 0.0)
        self._yaw = start.yaw_rad
        self._w = 0.0
        self.armed = False
        self.landed = self._x[2] <= 0.0

    @property
    def radius_m(self) -> float:
        """Radius of the sphere around the vehicle."""
        return self._limits.radius_m

    def step(self, wanted: Setpoint, dt_s: float) -> float:
        """Simulates one sample; returns the speed of an impact on the ground, else 0."""
        if self.landed:
            # a landed vehicle ignores horizontal set-points
            if not self.armed or wanted.vz_m_s < _LIFT_M_S:
                self._accel = (0.0, 0.0, 0.0)
                return 0.0
            self.landed = False
        before = tuple(self._v)
        if self.armed:
            self._follow(wanted, dt_s)
        else:
            self._v[2] -= GRAVITY_M_S2 * dt_s
        for axis in range(3):
            # the mean of the old and the new velocity is exact for a constant acceleration
            self._x[axis] += (before[axis] + self._v[axis]) / 2 * dt_s
        self._yaw = math.remainder(self._yaw + self._w * dt_s, math.tau)
        self._accel = (
            (self._v[0] - before[0]) / dt_s,
            (self._v[1] - before[1]) / dt_s,
            (self._v[2] - before[2]) / dt_s,
        )
        if self._x[2] <= 0.0 and self._v[2] <= 0.0:
            return self._touch_down()
        return 0.0

    def _follow(self, wanted: Setpoint, dt_s: float) -> None:
        limits = self._limits
        cos, sin = math.cos(self._yaw), math.sin(self._yaw)
        vx = wanted.vx_m_s * cos - wanted.vy_m_s * sin
        vy = wanted.vx_m_s * sin + wanted.vy_m_s * cos
        scale = min(1.0, limits.v_max_m_s / max(math.hypot(vx, vy), 1e-9))
        vz = min(max(wanted.vz_m_s, -limits.sink_max_m_s), limits.climb_max_m_s)
        share = 1 - math.exp(-dt_s / limits.tau_s)
        dv = [
            (target - now) * share for target, now in zip((vx * scale, vy * scale, vz), self._v, strict=True)
        ]
        max_dv = limits.a_max_m_s2 * dt_s
        # scaled in common, so that the limit does not change the direction
        flat = min(1.0, max_dv / max(math.hypot(dv[0], dv[1]), 1e-12))
        self._v[0] += dv[0] * flat
        self._v[1] += dv[1] * flat
        self._v[2] += min(max(dv[2], -max_dv), max_dv)
        w = min(max(wanted.wz_rad_s, -limits.w_max_rad_s), limits.w_max_rad_s)
        self._w += (w - self._w) * (1 - math.exp(-dt_s / limits.w_tau_s))

    def _touch_down(self) -> float:
        speed = math.hypot(*self._v)
        sink = -self._v[2]
        self.stop_at(self._x[0], self._x[1], 0.0)
        self.landed = True
        return speed if sink > self._limits.hard_landing_m_s else 0.0

    def stop_at(self, x_m: float, y_m: float, z_m: float) -> None:
        """Stops the vehicle at an obstacle that it hit."""
        self._x = [x_m, y_m, z_m]
        self._v = [0.0, 0.0, 0.0]
        self._w = 0.0
        self._accel = (0.0, 0.0, 0.0)

    def pose(self) -> Pose:
        """The true pose of the vehicle."""
        velocity = (self._v[0], self._v[1], self._v[2])
        return Pose.planar(self._x[0], self._x[1], self._x[2], self._yaw, velocity, self._w)

    def rates(self) -> Vector:
        """Rates about the body axes."""
        return 0.0, 0.0, self._w

    def specific_force(self) -> Vector:
        """Specific force in the axes of a level body: acceleration, and the reaction to gravity."""
        cos, sin = math.cos(self._yaw), math.sin(self._yaw)
        ax, ay, az = self._accel
        return ax * cos + ay * sin, ay * cos - ax * sin, az + GRAVITY_M_S2

    def power_w(self) -> float:
        """Electric power in W."""
        if self.landed:
            return self._limits.power_w * _IDLE
        return self._limits.power_w + math.hypot(*self._v) * self._limits.power_per_m_s_w
