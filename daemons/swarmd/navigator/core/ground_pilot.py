"""The pilot of a ground vehicle: how fast it should be, and the planner that finds a way."""

import math
from typing import Final

from swarmd.navigator.config import Config
from swarmd.navigator.core.detour import Detour
from swarmd.navigator.core.dwa import Planner
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.types.vehicle import Pose, Setpoint

_TURN_KP_1_S: Final = 1.5
"""Turning on the spot: rad/s for each radian."""
_THERE_RAD: Final = 0.05
_MOVES_M_S: Final = 0.05
_STUCK_M_S: Final = 0.1
"""Slower than this, while it should move, a vehicle is caught between the terms of its planner …"""
_IMPATIENCE_1_S: Final = 2.0
_MOST_HURRY: Final = 20.0
"""… and the weight of the speed grows by this much a second, up to this."""
_LEAST_REACH_M: Final = 3.0
"""Space that is looked at even by a vehicle that stands."""


class GroundPilot:
    """Speed and yaw rate from a target, for a vehicle that cannot go sideways."""

    __slots__ = ("_config", "_detour", "_last", "_moved_ns", "_planned_ns", "_planner", "free")

    flies = False

    def __init__(self, config: Config) -> None:
        self._config = config
        self._planner = Planner(config.dwa)
        self._detour = Detour(config.dwa)
        self._planned_ns = -(1 << 62)
        self._moved_ns: int | None = None
        self._last = Setpoint(0.0)
        self.free = True
        """Whether the last plan found a way to move."""

    def set_config(self, config: Config) -> None:
        """New weights and gains."""
        self._config = config
        self._planner.set_weights(config.dwa)
        self._detour.set_limits(config.dwa)

    def stop(self) -> Setpoint:
        """Stand still."""
        self._last = Setpoint(0.0)
        self._planned_ns = -(1 << 62)
        self._moved_ns = None
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
        aim = self._detour.aim(pose, target.ahead_m, self._reach(pose, v, target), around)
        wanted = self._speed(pose, target, aim)
        if self._moved_ns is None or abs(v) > _STUCK_M_S or abs(wanted) < 2 * _STUCK_M_S:
            self._moved_ns = now_ns
        hurry = 1 + _IMPATIENCE_1_S * (now_ns - self._moved_ns) / 1e9
        choice = self._planner.plan(pose, v, aim, wanted, around, min(hurry, _MOST_HURRY))
        self.free = choice.free
        w = choice.w_rad_s
        if choice.score == -math.inf and v > _MOVES_M_S:
            # braking holds the arc: that one was free for as long as it takes, and straight on may not be
            w = pose.wz_rad_s * max(0.0, 1 - self._config.dwa.a_max_m_s2 / self._config.plan_hz / v)
        self._last = Setpoint(choice.v_m_s, 0.0, 0.0, w)
        return self._last

    def _there(self, pose: Pose, target: Target) -> bool:
        moves = math.hypot(*target.velocity_m_s) > 0.05
        return (
            not moves and math.hypot(target.x_m - pose.x_m, target.y_m - pose.y_m) < self._config.arrive_m / 2
        )

    def _reach(self, pose: Pose, v_m_s: float, target: Target) -> float:
        """How far the way should be free: the planner's horizon, but not beyond a place that stands."""
        reach = max(_LEAST_REACH_M, abs(v_m_s) * self._config.dwa.horizon_s)
        if math.hypot(*target.velocity_m_s) > _MOVES_M_S:
            return reach
        return min(reach, math.hypot(target.x_m - pose.x_m, target.y_m - pose.y_m))

    def _speed(self, pose: Pose, target: Target, aim_m: tuple[float, float]) -> float:
        """Wanted speed: that of the place, and more when it is ahead."""
        config = self._config
        dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
        distance = math.hypot(dx, dy)
        # how far behind it is counts along the wanted way: seen along a detour, the place may lie behind
        bearing = math.atan2(target.ahead_m[1] - pose.y_m, target.ahead_m[0] - pose.x_m)
        cos, sin = math.cos(bearing), math.sin(bearing)
        along = dx * cos + dy * sin
        place = target.velocity_m_s[0] * cos + target.velocity_m_s[1] * sin
        braking = math.sqrt(2 * 0.5 * config.dwa.a_max_m_s2 * distance)
        more = math.copysign(min(config.along_kp_1_s * abs(along), braking), along)
        # a vehicle that looks elsewhere turns before it drives; a wide detour is driven slowly
        aim = math.atan2(aim_m[1] - pose.y_m, aim_m[0] - pose.x_m)
        wanted = (place + more) * max(0.0, math.cos(aim - pose.yaw_rad)) * (1 + math.cos(aim - bearing)) / 2
        # a slot that runs away asks for more than the drive has: beyond it all speeds would be equally bad
        return min(max(wanted, -config.dwa.v_back_m_s), target.speed_m_s, config.dwa.v_max_m_s)
