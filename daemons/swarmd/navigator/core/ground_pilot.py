"""The pilot of a ground vehicle: how fast it should be, and the planner that finds a way."""

import math
from typing import Final

from swarmd.navigator.config import Config
from swarmd.navigator.core.dwa import Planner
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.types.vehicle import Pose, Setpoint

_TURN_KP_1_S: Final = 1.5
"""Turning on the spot: rad/s for each radian."""
_THERE_RAD: Final = 0.05


class GroundPilot:
    """Speed and yaw rate from a target, for a vehicle that cannot go sideways."""

    __slots__ = ("_config", "_last", "_planned_ns", "_planner", "free")

    flies = False

    def __init__(self, config: Config) -> None:
        self._config = config
        self._planner = Planner(config.dwa)
        self._planned_ns = -(1 << 62)
        self._last = Setpoint(0.0)
        self.free = True
        """Whether the last plan found a way to move."""

    def set_config(self, config: Config) -> None:
        """New weights and gains."""
        self._config = config
        self._planner.set_weights(config.dwa)

    def stop(self) -> Setpoint:
        """Stand still."""
        self._last = Setpoint(0.0)
        self._planned_ns = -(1 << 62)
        return self._last

    def steer(self, pose: Pose, target: Target, around: Surroundings, now_ns: int) -> Setpoint:
        """The set-point for now; a new plan is made when one is due."""
        if now_ns - self._planned_ns < 0.99e9 / self._config.plan_hz:
            return self._last
        self._planned_ns = now_ns
        yaw = pose.yaw_rad
        cos, sin = math.cos(yaw), math.sin(yaw)
        v = pose.vx_m_s * cos + pose.vy_m_s * sin
        if target.yaw_rad is not None and self._there(pose, target):
            wrong = math.remainder(target.yaw_rad - yaw, math.tau)
            w = _TURN_KP_1_S * wrong if abs(wrong) > _THERE_RAD else 0.0
            most = self._config.dwa.w_max_rad_s
            self._last = Setpoint(0.0, 0.0, 0.0, min(max(w, -most), most))
            return self._last
        choice = self._planner.plan(pose, v, target.ahead_m, self._speed(pose, target), around)
        self.free = choice.free
        self._last = Setpoint(choice.v_m_s, 0.0, 0.0, choice.w_rad_s)
        return self._last

    def _there(self, pose: Pose, target: Target) -> bool:
        moves = math.hypot(*target.velocity_m_s) > 0.05
        return (
            not moves and math.hypot(target.x_m - pose.x_m, target.y_m - pose.y_m) < self._config.arrive_m / 2
        )

    def _speed(self, pose: Pose, target: Target) -> float:
        """Wanted speed: that of the place, and more when it is ahead."""
        config = self._config
        dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
        distance = math.hypot(dx, dy)
        bearing = math.atan2(target.ahead_m[1] - pose.y_m, target.ahead_m[0] - pose.x_m)
        aside = math.remainder(bearing - pose.yaw_rad, math.tau)
        cos, sin = math.cos(bearing), math.sin(bearing)
        along = dx * cos + dy * sin
        place = target.velocity_m_s[0] * cos + target.velocity_m_s[1] * sin
        braking = math.sqrt(2 * 0.5 * config.dwa.a_max_m_s2 * distance)
        more = math.copysign(min(config.along_kp_1_s * abs(along), braking), along)
        # a vehicle that looks elsewhere turns before it drives
        wanted = (place + more) * max(0.0, math.cos(aside))
        return min(max(wanted, -config.dwa.v_back_m_s), target.speed_m_s)
