"""Reference of the planner: the dynamic window over arrays, with complete computation of all candidates."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmd.navigator.config import DwaConfig
from swarmd.navigator.core.dwa import Choice, window
from swarmd.navigator.core.target import PLATFORM_HEIGHT_M, PLATFORM_RADIUS_M, Surroundings
from swarmware.types.vehicle import Pose

Array = NDArray[np.float64]

_STRAIGHT: Final = 1e-6
_STANDS_M_S: Final = 0.05
_MARGIN_NOISE_M: Final = 0.02
_NEVER_M: Final = 1e6


def safe_speed(distance: Array, deceleration: float) -> Array:
    answer: Array = np.sqrt(2.0 * np.maximum(distance, 0.0) * deceleration)
    return answer


def objective(
    weights: DwaConfig, heading: Array, distance: Array, velocity: Array, speed_gain: float = 1.0
) -> Array:
    """G of equation 5, with each term from 0 (bad) to 1 (good); `speed_gain` scales the last."""
    return (
        weights.heading_weight * heading
        + weights.distance_weight * distance
        + weights.velocity_weight * speed_gain * velocity
    )


class ArrayPlanner:
    """Dynamic window planner: chooses speed and yaw rate of a ground vehicle."""

    __slots__ = ("_limits", "_times")

    def __init__(self, limits: DwaConfig) -> None:
        self._limits = limits
        self._times: Array = np.linspace(0.0, limits.horizon_s, limits.steps + 1)[1:]

    def set_weights(self, limits: DwaConfig) -> None:
        """Replaces the weights, also while driving; the horizon is fixed."""
        self._limits = limits

    def plan(
        self,
        pose: Pose,
        v_m_s: float,
        ahead_m: tuple[float, float],
        v_wanted_m_s: float,
        around: Surroundings,
        speed_gain: float = 1.0,
    ) -> Choice:
        """The best pair of speed and yaw rate towards a point, safe, and close to the commanded speed."""
        limits = self._limits
        lim = window(limits, v_m_s, pose.wz_rad_s)
        wanted = min(max(v_wanted_m_s, lim.v_min_m_s), lim.v_max_m_s)
        vs = np.append(np.linspace(lim.v_min_m_s, lim.v_max_m_s, limits.v_samples), wanted)
        ws = np.append(np.linspace(lim.w_min_rad_s, lim.w_max_rad_s, limits.w_samples), 0.0)
        if not lim.w_min_rad_s <= 0.0 <= lim.w_max_rad_s:
            ws = ws[:-1]
        v, w = (grid.ravel() for grid in np.meshgrid(vs, ws))
        clear, travel = self._clearance(pose, v, w, around)
        admissible = np.abs(v) <= safe_speed(travel, limits.a_max_m_s2)
        # an arc of this length turns by length / radius = length · ω / v: the remaining angle
        turn = np.minimum(travel, _NEVER_M) * np.abs(w) / np.maximum(np.abs(v), _STANDS_M_S)
        admissible &= (np.abs(w) <= safe_speed(turn, limits.dw_max_rad_s2)) | (np.abs(v) < _STANDS_M_S)
        score = objective(
            limits,
            self._heading(pose, v, w, ahead_m),
            np.clip(clear / limits.clear_m, 0.0, 1.0),
            1.0 - np.minimum(np.abs(v - v_wanted_m_s) / limits.v_max_m_s, 1.0),
            speed_gain,
        )
        score[~admissible] = -np.inf
        best = int(np.argmax(score))
        if not admissible[best]:
            return Choice(0.0, 0.0, -math.inf, False)
        free = bool(np.any(admissible & (v > _STANDS_M_S)))
        return Choice(float(v[best]), float(w[best]), float(score[best]), free)

    def _heading(self, pose: Pose, v: Array, w: Array, ahead_m: tuple[float, float]) -> Array:
        """Heading term at the predicted pose: 1 towards the point, 0 away from it."""
        x, y, yaw = _arcs(pose, v, w, self._limits.heading_s)
        error = np.arctan2(ahead_m[1] - y, ahead_m[0] - x) - yaw
        answer: Array = 1.0 - np.abs((error + np.pi) % (2 * np.pi) - np.pi) / np.pi
        return answer

    def _clearance(self, pose: Pose, v: Array, w: Array, around: Surroundings) -> tuple[Array, Array]:
        """Minimum clearance of each trajectory, and its length until a contact, or infinity without a
        contact."""
        limits = self._limits
        times = self._times
        clear = np.full(v.shape, np.inf)
        contact = np.full((v.size, times.size), False)
        x, y, _ = _arcs(pose, v[:, None], w[:, None], times[None, :])
        reach = limits.v_max_m_s * limits.horizon_s + limits.radius_m + limits.clear_m
        points = [p for p in around.points_m if math.dist(p, (pose.x_m, pose.y_m)) < reach]
        if points:
            px, py = np.array(points).T
            gap2 = (x[:, :, None] - px) ** 2 + (y[:, :, None] - py) ** 2
            gap = np.sqrt(gap2.min(axis=2)) - limits.radius_m
            clear = np.minimum(clear, gap.min(axis=1))
            now = min(math.dist(p, (pose.x_m, pose.y_m)) for p in points) - limits.radius_m
            contact |= gap < self._required_clearance(now)
        near = [
            n
            for n in around.neighbours
            if abs(n.z_m - pose.z_m) < PLATFORM_HEIGHT_M
            and math.hypot(n.x_m - pose.x_m, n.y_m - pose.y_m) < 2 * reach
        ]
        if near:
            table = np.array([(n.x_m, n.y_m, n.vx_m_s, n.vy_m_s) for n in near]).T[:, None, :]
            nx, ny = table[0] + table[2] * times[:, None], table[1] + table[3] * times[:, None]
            gap2 = (x[:, :, None] - nx) ** 2 + (y[:, :, None] - ny) ** 2
            bodies = limits.radius_m + PLATFORM_RADIUS_M
            gap = np.sqrt(gap2.min(axis=2)) - bodies
            clear = np.minimum(clear, gap.min(axis=1))
            now = min(math.hypot(n.x_m - pose.x_m, n.y_m - pose.y_m) for n in near) - bodies
            contact |= gap < self._required_clearance(now)
        first = np.argmax(contact, axis=1)
        hit = contact[np.arange(v.size), first]
        # a contact is detected at the end of its step, so it may happen up to one step earlier
        begin = np.where(first > 0, times[first - 1], 0.0)
        travel = np.where(hit, np.abs(v) * begin, np.inf)
        return clear, travel

    def _required_clearance(self, now_m: float) -> float:
        """Clearance to keep: the margin, or the current one if smaller, so that the vehicle can leave."""
        return min(self._limits.margin_m, max(0.0, now_m - _MARGIN_NOISE_M))


def _arcs(pose: Pose, v: Array, w: Array, t: Array | float) -> tuple[Array, Array, Array]:
    """Poses after a time t at constant speeds, in closed form."""
    yaw = pose.yaw_rad
    turned = w * t
    straight = np.abs(w) < _STRAIGHT
    safe = np.where(straight, 1.0, w)
    # chord of the arc: v/ω · (sin(φ+ωt) − sin φ), and its limit for small ω
    x = np.where(straight, v * t * math.cos(yaw), v / safe * (np.sin(yaw + turned) - math.sin(yaw)))
    y = np.where(straight, v * t * math.sin(yaw), v / safe * (math.cos(yaw) - np.cos(yaw + turned)))
    return pose.x_m + x, pose.y_m + y, yaw + turned
