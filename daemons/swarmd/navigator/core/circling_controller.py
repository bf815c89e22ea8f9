"""Controller of a fixed-wing aircraft, which cannot stop and circles around its target."""

import math
from typing import Final

import msgspec

from swarmd.navigator.config import Config
from swarmd.navigator.core.air_controller import avoid
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.types.vehicle import Pose, Setpoint

_ORBIT_GAIN: Final = 2.5
"""Gain of the vector field around a circle, which turns the course inwards with the relative distance."""
_ON_CIRCLE: Final = 0.4
"""Ratio of deviation to radius within which the turn rate of the circle is fed forward."""
_ARRIVE_RATIO: Final = 0.06
"""Ratio of the arrival radius to the radius of the circle."""
_CLIMB_KP_1_S: Final = 0.4
"""Climb rate per metre of height error."""
_CLEARANCE_M: Final = 5.0
"""Distance kept in addition to twice the vehicle's radius, because an aircraft cannot stop for others."""
_LINE_GAIN_1_M: Final = 0.03
"""Gain of the vector field along a line; the angle to the line is atan(gain · distance)."""
_FINAL_M: Final = 180.0
"""Length of the final approach, including the distance of the flare."""
_GLIDE: Final = 0.1
"""Slope of the final approach."""
_FLARE_M: Final = 90.0
"""Distance from the touch-down at which the glide path meets the ground, because the flare carries
further."""
_ALIGNED_RAD: Final = 0.2
"""Maximum deviation of the course at the begin of the final approach."""
_NEAR_M: Final = 40.0
"""Maximum distance from the planned begin of the final approach at which it may begin."""
_HIGH_M: Final = 3.0
"""Maximum height above the glide path at which the final approach may begin."""


class Approach(msgspec.Struct, frozen=True):
    """A landing on a circle that touches the begin of the final approach, and on a line down to the place."""

    x_m: float
    y_m: float
    """Position of the touch-down."""
    course_rad: float
    stay: Target
    """Target that the aircraft held before the landing."""
    final: bool = False
    """True if the aircraft has left the circle."""

    @property
    def begin_m(self) -> tuple[float, float]:
        """Begin of the final approach."""
        return (
            self.x_m - _FINAL_M * math.cos(self.course_rad),
            self.y_m - _FINAL_M * math.sin(self.course_rad),
        )


class CirclingController:
    """Computes velocity set-points for an aircraft: straight to a far target, then to the left around it.

    Source: Beard and McLain 2012, "Small Unmanned Aircraft", chapter 10 (vector fields of line and orbit).
    """

    __slots__ = ("_approach", "_clear_m", "_config", "_limits", "free")

    flies = True

    def __init__(self, config: Config, airframe: FixedWingAirframe) -> None:
        self._limits = airframe.limits
        self._clear_m = 2 * airframe.body.radius_m + _CLEARANCE_M
        self._approach: Approach | None = None
        self.free = True
        """Always True, because in the air there is a way around an obstacle."""
        self.set_config(config)

    @property
    def circle_m(self) -> float:
        """Radius of the circle around a target."""
        return self._limits.loiter_radius_m

    @property
    def arrive_m(self) -> float:
        """Minimum arrival radius, the deviation of the flown circle from a perfect circle."""
        return _ARRIVE_RATIO * self._limits.loiter_radius_m

    def set_config(self, config: Config) -> None:
        """Replaces the settings; avoidance uses the size and the limits of the airframe."""
        limits = self._limits
        air = msgspec.structs.replace(
            config.air,
            v_max_m_s=limits.airspeed_max_m_s,
            climb_max_m_s=limits.climb_max_m_s,
            sink_max_m_s=limits.sink_max_m_s,
            separation_m=max(config.air.separation_m, self._clear_m),
            obstacle_m=max(config.air.obstacle_m, self._clear_m),
        )
        self._config = msgspec.structs.replace(config, air=air)

    def stop(self) -> Setpoint:
        """Set-point without a velocity, at which the aircraft circles, or rests on the ground."""
        self._approach = None
        return Setpoint(0.0)

    def sink(self, rate_m_s: float) -> Setpoint:
        """Set-point of a descent without a position, on the circle that the flight controller flies."""
        self._approach = None
        return Setpoint(0.0, vz_m_s=-rate_m_s)

    def hold_at(self, pose: Pose) -> tuple[float, float]:
        """Centre of the circle to the left that begins at this pose."""
        course = _course_rad(pose)
        return pose.x_m - self.circle_m * math.sin(course), pose.y_m + self.circle_m * math.cos(course)

    def descend(self, pose: Pose, stay: Target, speed_m_s: float) -> Target:
        """Target of a landing: down on a circle, then along the final approach."""
        approach = self._approach
        # planned once: a new plan at each step would move the touch-down with the aircraft
        if approach is None or approach.stay != stay:
            course = _course_rad(pose)
            radius = self.circle_m
            # the held circle touches the line of the approach at the touch-down
            x, y = stay.x_m + radius * math.sin(course), stay.y_m - radius * math.cos(course)
            approach = Approach(x, y, course, stay)
        x, y = approach.begin_m
        high_m = _GLIDE * (_FINAL_M - _FLARE_M)
        if not approach.final:
            aligned = abs(math.remainder(_course_rad(pose) - approach.course_rad, math.tau)) < _ALIGNED_RAD
            near = math.hypot(x - pose.x_m, y - pose.y_m) < _NEAR_M
            approach = msgspec.structs.replace(
                approach, final=aligned and near and pose.z_m < high_m + _HIGH_M
            )
        self._approach = approach
        cos, sin = math.cos(approach.course_rad), math.sin(approach.course_rad)
        if not approach.final:
            radius = self.circle_m
            # centre of a circle to the left that touches the line at its begin
            x, y = x - radius * sin, y + radius * cos
            return Target(x, y, high_m, None, 0.0, (x, y), climb_m_s=self._limits.sink_max_m_s)
        dx, dy = approach.x_m - pose.x_m, approach.y_m - pose.y_m
        along, left = dx * cos + dy * sin, dx * sin - dy * cos
        glide_m = _GLIDE * (along - _FLARE_M)
        sink = _GLIDE * self._limits.airspeed_cruise_m_s
        return Target(
            approach.x_m,
            approach.y_m,
            glide_m,
            None,
            0.0,
            (approach.x_m, approach.y_m),
            (0.0, 0.0, -sink),
            course_rad=approach.course_rad - math.atan(_LINE_GAIN_1_M * left),
        )

    def steer(self, pose: Pose, target: Target, around: Surroundings, now_ns: int) -> Setpoint:
        """Computes the set-point of one control step.

        A commanded speed below the minimum airspeed is replaced by the cruise speed.
        """
        limits = self._limits
        speed = min(target.speed_m_s, limits.airspeed_max_m_s)
        # slower it would stall
        if speed < limits.airspeed_min_m_s:
            speed = limits.airspeed_cruise_m_s
        course, turn = self._guide(pose, target, speed)
        climb = _CLIMB_KP_1_S * (target.z_m - pose.z_m)
        climb = min(max(climb, -target.climb_m_s), target.climb_m_s) + target.velocity_m_s[2]
        climb = min(max(climb, -limits.sink_max_m_s), limits.climb_max_m_s)
        wanted = (speed * math.cos(course), speed * math.sin(course), climb)
        # at full speed only, because an aircraft cannot slow down to evade
        vx, vy, vz = evaded = avoid(self._config, pose, wanted, around, speeds=(1.0,))
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        return Setpoint(vx * cos + vy * sin, vy * cos - vx * sin, vz, turn if evaded == wanted else 0.0)

    def _guide(self, pose: Pose, target: Target, speed_m_s: float) -> tuple[float, float]:
        """Course and rate of turn, along the course of the target or around the target."""
        if target.course_rad is not None:
            return target.course_rad, 0.0
        radius = self.circle_m
        dx, dy = pose.x_m - target.x_m, pose.y_m - target.y_m
        away = math.hypot(dx, dy)
        deviation = (away - radius) / radius
        # the tangent to the left, turned towards the circle by the deviation
        course = math.atan2(dy, dx) + math.pi / 2 + math.atan(_ORBIT_GAIN * deviation)
        turn = speed_m_s / max(away, 1.0) if abs(deviation) < _ON_CIRCLE else 0.0
        return course, turn


def _course_rad(pose: Pose) -> float:
    """Direction of motion, or the heading of an aircraft at rest."""
    if math.hypot(pose.vx_m_s, pose.vy_m_s) < 1.0:
        return pose.yaw_rad
    return math.atan2(pose.vy_m_s, pose.vx_m_s)
