"""Controller of a ground vehicle, with speed and heading control, and a planner that avoids obstacles."""

import math
from typing import Final

from swarmd.navigator.config import Config
from swarmd.navigator.core.detour import Detour
from swarmd.navigator.core.dwa import Planner
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.types.vehicle import Pose, Setpoint

_TURN_KP_1_S: Final = 1.5
"""Gain of turning on the spot, in rad/s per radian."""
_YAW_TOLERANCE_RAD: Final = 0.05
_MOVES_M_S: Final = 0.05
_STUCK_M_S: Final = 0.1
"""Speed below which a vehicle that should move is in a local minimum of its planner."""
_SPEED_GAIN_1_S: Final = 2.0
_SPEED_GAIN_MAX: Final = 20.0
"""Growth per second of the speed term's weight in a local minimum of the planner, and its maximum."""
_EFFECT_RATIO: Final = 0.5
"""Ratio of the longest delay after which a set-point usually takes effect. Measured in the simulation of
delayed vehicles (tests/simulation/formation): with 0 they oscillate about their path, with 0.7 they cut
corners."""
_REACH_MIN_M: Final = 3.0
"""Minimum distance that is checked for obstacles, even at rest."""


class GroundController:
    """Computes speed and yaw rate towards a target, for a nonholonomic vehicle."""

    __slots__ = ("_config", "_detour", "_last", "_moved_ns", "_planned_ns", "_planner", "free")

    flies = False
    circle_m: Final = 0.0
    arrive_m: Final = 0.0

    def __init__(self, config: Config) -> None:
        self._config = config
        self._planner = Planner(config.dwa)
        self._detour = Detour(config.dwa)
        self._planned_ns = -(1 << 62)
        self._moved_ns: int | None = None
        self._last = Setpoint(0.0)
        self.free = True
        """True if the last plan found an admissible motion."""

    def set_config(self, config: Config) -> None:
        """Replaces weights and gains."""
        self._config = config
        self._planner.set_weights(config.dwa)
        self._detour.set_limits(config.dwa)

    def stop(self) -> Setpoint:
        """Set-point of zero velocity; the next `steer` plans at once."""
        self._last = Setpoint(0.0)
        self._planned_ns = -(1 << 62)
        self._moved_ns = None
        return self._last

    def sink(self, rate_m_s: float) -> Setpoint:
        """Set-point of zero velocity, because a ground vehicle cannot descend."""
        return self.stop()

    def hold_at(self, pose: Pose) -> tuple[float, float]:
        """The present position, at which a ground vehicle stops."""
        return pose.x_m, pose.y_m

    def descend(self, pose: Pose, stay: Target, speed_m_s: float) -> Target:
        """The present target, because a ground vehicle does not land."""
        return stay

    def steer(self, pose: Pose, target: Target, around: Surroundings, now_ns: int) -> Setpoint:
        """Computes the set-point of one control step; plans when the period of the planner is over."""
        # 1 % early, so that jitter of the steps does not skip a plan
        if now_ns - self._planned_ns < 0.99e9 / self._config.plan_hz:
            return self._last
        self._planned_ns = now_ns
        pose = self._effective(pose, around.delay_s)
        yaw = pose.yaw_rad
        cos, sin = math.cos(yaw), math.sin(yaw)
        # the component along the heading; a ground vehicle has no other
        v = pose.vx_m_s * cos + pose.vy_m_s * sin
        if target.yaw_rad is not None and self._is_at(pose, target):
            yaw_error = math.remainder(target.yaw_rad - yaw, math.tau)
            w = _TURN_KP_1_S * yaw_error if abs(yaw_error) > _YAW_TOLERANCE_RAD else 0.0
            w_max = self._config.dwa.w_max_rad_s
            self._last = Setpoint(0.0, 0.0, 0.0, min(max(w, -w_max), w_max))
            return self._last
        aim = self._detour.aim(pose, target.ahead_m, self._reach(pose, v, target), around)
        wanted = self._speed(pose, target, aim)
        if self._moved_ns is None or abs(v) > _STUCK_M_S or abs(wanted) < 2 * _STUCK_M_S:
            self._moved_ns = now_ns
        # in a local minimum a growing weight of the speed lets the vehicle leave it sideways
        speed_gain = 1 + _SPEED_GAIN_1_S * (now_ns - self._moved_ns) / 1e9
        choice = self._planner.plan(pose, v, aim, wanted, around, min(speed_gain, _SPEED_GAIN_MAX))
        self.free = choice.free
        w = choice.w_rad_s
        if choice.score == -math.inf and v > _MOVES_M_S:
            # brakes on the same arc, which was free for the braking distance, unlike the straight line
            step_s = 1 / self._config.plan_hz + _EFFECT_RATIO * around.delay_s
            w = pose.wz_rad_s * max(0.0, 1 - self._config.dwa.a_max_m_s2 * step_s / v)
        self._last = Setpoint(choice.v_m_s, 0.0, 0.0, w)
        return self._last

    def _effective(self, pose: Pose, delay_s: float) -> Pose:
        """The pose at which a new set-point takes effect; until then a delayed vehicle follows the last
        set-point.

        Planned from the present pose, turns would begin and end late, and the vehicle would oscillate about
        its path.
        """
        if delay_s == 0.0:
            return pose
        lag_s, last, limits = _EFFECT_RATIO * delay_s, self._last, self._config.dwa
        dv, dw = limits.a_max_m_s2 * lag_s, limits.dw_max_rad_s2 * lag_s
        v = pose.vx_m_s * math.cos(pose.yaw_rad) + pose.vy_m_s * math.sin(pose.yaw_rad)
        v_then = min(max(last.vx_m_s, v - dv), v + dv)
        w_then = min(max(last.wz_rad_s, pose.wz_rad_s - dw), pose.wz_rad_s + dw)
        turn = (pose.wz_rad_s + w_then) / 2 * lag_s
        way, yaw, chord = (v + v_then) / 2 * lag_s, pose.yaw_rad + turn, pose.yaw_rad + turn / 2
        return Pose.planar(
            pose.x_m + way * math.cos(chord),
            pose.y_m + way * math.sin(chord),
            pose.z_m,
            yaw,
            (v_then * math.cos(yaw), v_then * math.sin(yaw), 0.0),
            w_then,
        )

    def _is_at(self, pose: Pose, target: Target) -> bool:
        moves = math.hypot(*target.velocity_m_s) > 0.05
        return (
            not moves and math.hypot(target.x_m - pose.x_m, target.y_m - pose.y_m) < self._config.arrive_m / 2
        )

    def _reach(self, pose: Pose, v_m_s: float, target: Target) -> float:
        """Distance that should be free, up to the planner's horizon but not beyond a target at rest."""
        reach = max(_REACH_MIN_M, abs(v_m_s) * self._config.dwa.horizon_s)
        if math.hypot(*target.velocity_m_s) > _MOVES_M_S:
            return reach
        return min(reach, math.hypot(target.x_m - pose.x_m, target.y_m - pose.y_m))

    def _speed(self, pose: Pose, target: Target, aim_m: tuple[float, float]) -> float:
        """Commanded speed: the target's speed, plus a term proportional to the distance along the track."""
        config = self._config
        dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
        distance = math.hypot(dx, dy)
        # measured along the path and not along a detour, on which the target may lie behind the vehicle
        bearing = math.atan2(target.ahead_m[1] - pose.y_m, target.ahead_m[0] - pose.x_m)
        cos, sin = math.cos(bearing), math.sin(bearing)
        along = dx * cos + dy * sin
        place = target.velocity_m_s[0] * cos + target.velocity_m_s[1] * sin
        braking = math.sqrt(2 * 0.5 * config.dwa.a_max_m_s2 * distance)
        more = math.copysign(min(config.along_kp_1_s * abs(along), braking), along)
        # a vehicle with another heading turns before it drives; a wide detour is driven slowly
        aim = math.atan2(aim_m[1] - pose.y_m, aim_m[0] - pose.x_m)
        wanted = (place + more) * max(0.0, math.cos(aim - pose.yaw_rad)) * (1 + math.cos(aim - bearing)) / 2
        # limited to the drive's maximum, above which all candidates of the planner would have the same score
        return min(max(wanted, -config.dwa.v_back_m_s), target.speed_m_s, config.dwa.v_max_m_s)
