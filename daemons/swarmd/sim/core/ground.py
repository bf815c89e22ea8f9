"""Model of a ground vehicle: the kinematics of S0, with a drive with limits."""

import math
from typing import Final

import msgspec

from swarmd.sim.config import GroundLimits
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.vehicle import Pose, Setpoint


class GroundState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State vector X = (x, y, φ, v, ω) of a ground vehicle."""

    x_m: float
    y_m: float
    yaw_rad: float
    v_m_s: float = 0.0
    w_rad_s: float = 0.0


def advance(state: GroundState, v_m_s: float, w_rad_s: float, dt_s: float) -> GroundState:
    """Advances the state by one sample at constant speed: X' = F X + B u.

    F = diag{1, 1, 1, 0, 0}; B = [[cos φ dt, 0], [sin φ dt, 0], [0, dt], [1, 0], [0, 1]]; u = (v, ω).
    Source: S0, equations 1 to 3.
    """
    return GroundState(
        state.x_m + math.cos(state.yaw_rad) * dt_s * v_m_s,
        state.y_m + math.sin(state.yaw_rad) * dt_s * v_m_s,
        math.remainder(state.yaw_rad + dt_s * w_rad_s, math.tau),
        v_m_s,
        w_rad_s,
    )


class Ground:
    """Model of a vehicle with a differential drive."""

    __slots__ = ("_accel", "_limits", "armed", "state")

    flies = False
    landed = True
    safe: Final = Setpoint(0.0)
    stall_s: Final = 1.0

    def __init__(self, limits: GroundLimits, start: Pose) -> None:
        self._limits = limits
        self._accel = 0.0
        self.state = GroundState(start.x_m, start.y_m, start.yaw_rad)
        self.armed = False

    @property
    def radius_m(self) -> float:
        """Radius of the circle around the vehicle."""
        return self._limits.radius_m

    def step(self, wanted: Setpoint, dt_s: float) -> float:
        """Simulates one sample; returns the speed of an impact on the ground, always 0."""
        limits, old = self._limits, self.state
        if not self.armed:
            wanted = Setpoint(0.0)
        v = min(max(wanted.vx_m_s, -limits.v_back_m_s), limits.v_max_m_s)
        w = min(max(wanted.wz_rad_s, -limits.w_max_rad_s), limits.w_max_rad_s)
        dv, dw = limits.a_max_m_s2 * dt_s, limits.dw_max_rad_s2 * dt_s
        # limits of speed first, then of acceleration, from the present speed
        v = min(max(v, old.v_m_s - dv), old.v_m_s + dv)
        w = min(max(w, old.w_rad_s - dw), old.w_rad_s + dw)
        self._accel = (v - old.v_m_s) / dt_s
        self.state = advance(old, v, w, dt_s)
        return 0.0

    def stop_at(self, x_m: float, y_m: float, z_m: float) -> None:
        """Stops the vehicle at an obstacle that it hit."""
        # without speed: the obstacle has taken it
        self.state = GroundState(x_m, y_m, self.state.yaw_rad)

    def pose(self) -> Pose:
        """The true pose of the vehicle."""
        s = self.state
        velocity = (s.v_m_s * math.cos(s.yaw_rad), s.v_m_s * math.sin(s.yaw_rad), 0.0)
        return Pose.planar(s.x_m, s.y_m, 0.0, s.yaw_rad, velocity, s.w_rad_s)

    def rates(self) -> Vector:
        """Rates about the body axes."""
        return 0.0, 0.0, self.state.w_rad_s

    def specific_force(self) -> Vector:
        """Specific force in body axes: tangential, centripetal, and the reaction to gravity."""
        return self._accel, self.state.v_m_s * self.state.w_rad_s, GRAVITY_M_S2

    def power_w(self) -> float:
        """Electric power in W."""
        return self._limits.power_w + abs(self.state.v_m_s) * self._limits.power_per_m_s_w
