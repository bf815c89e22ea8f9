"""Model of a surface vessel with propellers, a first-order response of the hull, and sway in turns."""

import math
from typing import Final

import msgspec

from swarmd.sim.config import SurfaceLimits
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.vehicle import Pose, Setpoint


class SurfaceState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of a vessel: position and heading in the map; surge, sway and yaw rate in body axes."""

    x_m: float
    y_m: float
    yaw_rad: float
    surge_m_s: float = 0.0
    sway_m_s: float = 0.0
    w_rad_s: float = 0.0


class Surface:
    """Model of a surface vessel in water with a current.

    Surge and yaw rate follow the set-point as first-order systems; surge and sway are relative to the water.
    A turn at speed causes sway, which decays by drag. Source: Nomoto 1957 (steering); Fossen 2011, Handbook
    of Marine Craft, chapter 7 (sway).
    """

    __slots__ = ("_accel", "_limits", "armed", "state")

    flies = False
    landed = True
    safe: Final = Setpoint(0.0)
    stall_s: Final = 1.0

    def __init__(self, limits: SurfaceLimits, start: Pose) -> None:
        self._limits = limits
        self._accel = 0.0
        self.state = SurfaceState(start.x_m, start.y_m, start.yaw_rad)
        self.armed = False

    @property
    def radius_m(self) -> float:
        """Radius of the circle around the vessel."""
        return self._limits.radius_m

    def step(self, wanted: Setpoint, dt_s: float) -> float:
        """Simulates one sample; returns the speed of an impact on the ground, always 0.

        A disarmed vessel drifts to rest.
        """
        limits, old = self._limits, self.state
        if not self.armed:
            wanted = Setpoint(0.0)
        v = min(max(wanted.vx_m_s, -limits.v_back_m_s), limits.v_max_m_s)
        w = min(max(wanted.wz_rad_s, -limits.w_max_rad_s), limits.w_max_rad_s)
        max_dv = limits.a_max_m_s2 * dt_s
        dv = (v - old.surge_m_s) * (1 - math.exp(-dt_s / limits.tau_s))
        surge = old.surge_m_s + min(max(dv, -max_dv), max_dv)
        rate = old.w_rad_s + (w - old.w_rad_s) * (1 - math.exp(-dt_s / limits.w_tau_s))
        # in a turn the hull keeps its direction, which is sway in the body's axes
        slip = old.sway_m_s - surge * rate * dt_s
        sway = slip * math.exp(-dt_s / limits.sway_tau_s)
        self._accel = (surge - old.surge_m_s) / dt_s
        cos, sin = math.cos(old.yaw_rad), math.sin(old.yaw_rad)
        east, north = limits.current_m_s
        self.state = SurfaceState(
            old.x_m + (surge * cos - sway * sin + east) * dt_s,
            old.y_m + (surge * sin + sway * cos + north) * dt_s,
            math.remainder(old.yaw_rad + rate * dt_s, math.tau),
            surge,
            sway,
            rate,
        )
        return 0.0

    def stop_at(self, x_m: float, y_m: float, z_m: float) -> None:
        """Stops the vessel at an obstacle that it hit."""
        # without speed: the obstacle has taken it
        self.state = SurfaceState(x_m, y_m, self.state.yaw_rad)

    def pose(self) -> Pose:
        """The true pose of the vehicle."""
        s = self.state
        cos, sin = math.cos(s.yaw_rad), math.sin(s.yaw_rad)
        east, north = self._limits.current_m_s
        vx = s.surge_m_s * cos - s.sway_m_s * sin + east
        vy = s.surge_m_s * sin + s.sway_m_s * cos + north
        return Pose.planar(s.x_m, s.y_m, 0.0, s.yaw_rad, (vx, vy, 0.0), s.w_rad_s)

    def rates(self) -> Vector:
        """Rates about the body axes."""
        return 0.0, 0.0, self.state.w_rad_s

    def specific_force(self) -> Vector:
        """Specific force in body axes: tangential, centripetal, and the reaction to gravity."""
        return self._accel, self.state.surge_m_s * self.state.w_rad_s, GRAVITY_M_S2

    def power_w(self) -> float:
        """Electric power in W; the power of a propeller is proportional to the cube of the speed."""
        return self._limits.power_w + abs(self.state.surge_m_s) ** 3 * self._limits.power_per_m3_s3_w
