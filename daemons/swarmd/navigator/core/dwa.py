"""The dynamic window approach, which chooses the best of the safe and attainable speeds by three terms.

Source: S0, equations 4 and 5; Fox, Burgard, Thrun: The dynamic window approach to collision avoidance, 1997.

The candidates are evaluated in the order of their score without obstacles, until no further candidate can be
better, usually after the first few of 176. Compared with numpy arrays of all candidates this takes half the
time without obstacles and up to twice the time with many obstacles, and saves 12 MB of memory.
"""

import math
from collections.abc import Iterator
from typing import Final

import msgspec

from swarmd.navigator.config import DwaConfig
from swarmd.navigator.core.target import PLATFORM_HEIGHT_M, PLATFORM_RADIUS_M, MovingObstacle, Surroundings
from swarmware.types.vehicle import Pose

Point = tuple[float, float]

_STRAIGHT: Final = 1e-6
_STANDS_M_S: Final = 0.05
"""Speed below which a motion counts as turning on the spot."""
_MARGIN_NOISE_M: Final = 0.02
"""Tolerated decrease of a clearance that is already too small, for the noise of measurements."""
_LATE_RATIO: Final = 0.8
"""Ratio of the distance covered during the scheduling delay that is added to the margin, for the error of the
estimate and for arcs that are left late. With 0.5 and at most 0.6 m, 3 of 24 simulated flights with steps of
0.25 s had a contact (tests/simulation/formation), with these values one, without the addition 7."""
_LATE_MAX_M: Final = 0.8
"""Maximum addition to the margin, so that passages between obstacles stay open."""
_NEVER_M: Final = 1e6
"""Distance larger than the distance of any contact."""


class DynamicWindow(msgspec.Struct, frozen=True):
    """Speeds V_lim that the drive can attain within the time of the window."""

    v_min_m_s: float
    v_max_m_s: float
    w_min_rad_s: float
    w_max_rad_s: float


class Choice(msgspec.Struct, frozen=True):
    """The best pair of speed and yaw rate, with its score."""

    v_m_s: float
    w_rad_s: float
    score: float
    """Score G, or minus infinity if no pair was admissible."""
    free: bool
    """True if a pair that moves the vehicle was admissible."""


class Motion(msgspec.Struct, frozen=True, gc=False):
    """A candidate pair of speed and yaw rate."""

    v_m_s: float
    w_rad_s: float
    heading: float
    """Heading term, from 0 to 1."""
    velocity: float
    """Speed term, from 0 to 1."""
    bound: float
    """Score G without near obstacles, which is an upper bound."""


def safe_speed(distance: float, deceleration: float) -> float:
    """V_safe of equation 4, the maximum speed at which the vehicle stops within a distance: √(2·dist·a).

    Units: metres and m/s² give m/s; radians and rad/s² give rad/s.
    """
    return math.sqrt(2.0 * max(distance, 0.0) * deceleration)


def window(limits: DwaConfig, v_m_s: float, w_rad_s: float) -> DynamicWindow:
    """V_lim of equation 4, the limits of the drive reduced to the speeds attainable from the present
    speeds."""
    dv, dw = limits.a_max_m_s2 * limits.window_s, limits.dw_max_rad_s2 * limits.window_s
    v = min(max(v_m_s, -limits.v_back_m_s), limits.v_max_m_s)
    w = min(max(w_rad_s, -limits.w_max_rad_s), limits.w_max_rad_s)
    return DynamicWindow(
        max(-limits.v_back_m_s, v - dv),
        min(limits.v_max_m_s, v + dv),
        max(-limits.w_max_rad_s, w - dw),
        min(limits.w_max_rad_s, w + dw),
    )


def objective(
    weights: DwaConfig, heading: float, distance: float, velocity: float, speed_gain: float = 1.0
) -> float:
    """Score G of equation 5, with each term from 0 (bad) to 1 (good); `speed_gain` scales the speed term."""
    return (
        weights.heading_weight * heading
        + weights.distance_weight * distance
        + weights.velocity_weight * speed_gain * velocity
    )


class Planner:
    """Dynamic window planner, which chooses speed and yaw rate of a ground vehicle."""

    __slots__ = ("_limits", "_times")

    def __init__(self, limits: DwaConfig) -> None:
        self._limits = limits
        self._times = _spread(0.0, limits.horizon_s, limits.steps + 1)[1:]

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
        motions = list(self._motions(pose, v_m_s, ahead_m, v_wanted_m_s, speed_gain))
        order = sorted(range(len(motions)), key=lambda index: -motions[index].bound)
        obstacles = NearObstacles(limits, pose, around)
        best, found, free = -math.inf, -1, False
        for index in order:
            motion = motions[index]
            # no obstacle can raise the score above its bound
            if motion.bound < best and (free or motion.v_m_s <= _STANDS_M_S):
                if free:
                    break
                continue  # cannot be the best, and does not show whether the vehicle can move
            clear_m = self._clearance(pose, motion, obstacles)
            if clear_m is None:
                continue
            free = free or motion.v_m_s > _STANDS_M_S
            distance = min(max(clear_m / limits.clear_m, 0.0), 1.0)
            score = objective(limits, motion.heading, distance, motion.velocity, speed_gain)
            if score > best or (score == best and index < found):
                best, found = score, index
        if found < 0:
            return Choice(0.0, 0.0, -math.inf, False)
        return Choice(motions[found].v_m_s, motions[found].w_rad_s, best, free)

    def _motions(
        self, pose: Pose, v_m_s: float, ahead_m: tuple[float, float], v_wanted_m_s: float, speed_gain: float
    ) -> Iterator[Motion]:
        """Pairs of the dynamic window, each with the terms that do not depend on obstacles."""
        limits = self._limits
        lim = window(limits, v_m_s, pose.wz_rad_s)
        vs = _spread(lim.v_min_m_s, lim.v_max_m_s, limits.v_samples)
        vs.append(min(max(v_wanted_m_s, lim.v_min_m_s), lim.v_max_m_s))
        ws = _spread(lim.w_min_rad_s, lim.w_max_rad_s, limits.w_samples)
        if lim.w_min_rad_s <= 0.0 <= lim.w_max_rad_s:
            # the samples may leave out the straight motion, without which the vehicle would weave
            ws.append(0.0)
        dx, dy = ahead_m[0] - pose.x_m, ahead_m[1] - pose.y_m
        for w in ws:
            x, y = _chord(pose.yaw_rad, w, limits.heading_s)
            turned = pose.yaw_rad + w * limits.heading_s
            for v in vs:
                error = math.atan2(dy - v * y, dx - v * x) - turned
                heading = 1.0 - abs((error + math.pi) % math.tau - math.pi) / math.pi
                velocity = 1.0 - min(abs(v - v_wanted_m_s) / limits.v_max_m_s, 1.0)
                yield Motion(v, w, heading, velocity, objective(limits, heading, 1.0, velocity, speed_gain))

    def _clearance(self, pose: Pose, motion: Motion, obstacles: "NearObstacles") -> float | None:
        """Minimum clearance of a trajectory, up to the saturation of its term, or None if it is not safe."""
        clear_m, safe = math.inf, False
        v, w = motion.v_m_s, motion.w_rad_s
        points, movers = obstacles.near(abs(v) * self._limits.horizon_s)
        if not points and not movers:
            return clear_m if self._is_safe(motion, math.inf) else None
        begin_s = 0.0
        for time_s, x, y in obstacles.chords(w, self._times):
            at = (pose.x_m + v * x, pose.y_m + v * y)
            to_points, to_movers = obstacles.gaps_m(points, movers, at, time_s)
            clear_m = min(clear_m, to_points, to_movers)
            if not safe and obstacles.touches(to_points, to_movers):
                # a contact is detected at the end of its step, so it may happen up to one step earlier
                if not self._is_safe(motion, abs(v) * begin_s):
                    return None
                safe = True
            begin_s = time_s
        return clear_m if safe or self._is_safe(motion, math.inf) else None

    def _is_safe(self, motion: Motion, travel_m: float) -> bool:
        """True if the vehicle can stop moving and turning within a distance."""
        limits, v, w = self._limits, abs(motion.v_m_s), abs(motion.w_rad_s)
        if v > safe_speed(travel_m, limits.a_max_m_s2):
            return False
        # the remaining angle of an arc is length / radius = length · ω / v
        turn = min(travel_m, _NEVER_M) * w / max(v, _STANDS_M_S)
        return v < _STANDS_M_S or w <= safe_speed(turn, limits.dw_max_rad_s2)


class NearObstacles:
    """Obstacles that a trajectory may meet, with cached computations for all candidates of one plan."""

    __slots__ = (
        *("_bodies_m", "_chords", "_keep_m", "_limits", "_margin_m", "_movers", "_near", "_points"),
        *("_to_movers_m", "_to_points_m", "_yaw_rad"),
    )

    def __init__(self, limits: DwaConfig, pose: Pose, around: Surroundings) -> None:
        self._limits = limits
        self._bodies_m = limits.radius_m + PLATFORM_RADIUS_M
        here = (pose.x_m, pose.y_m)
        reach = limits.v_max_m_s * limits.horizon_s + limits.radius_m + limits.clear_m
        self._points = [(gap, p) for p in around.points_m if (gap := math.dist(p, here)) < reach]
        self._movers = [
            (gap, n)
            for n in around.neighbours
            if abs(n.z_m - pose.z_m) < PLATFORM_HEIGHT_M
            and (gap := math.hypot(n.x_m - pose.x_m, n.y_m - pose.y_m)) < 2 * reach
        ]
        speed_m_s = math.hypot(pose.vx_m_s, pose.vy_m_s)
        self._margin_m = limits.margin_m + min(_LATE_RATIO * around.delay_s * speed_m_s, _LATE_MAX_M)
        nearest_m = min((gap for gap, _ in self._points), default=0.0)
        self._to_points_m = self._required_clearance(nearest_m - limits.radius_m)
        nearest_m = min((gap for gap, _ in self._movers), default=0.0)
        self._to_movers_m = self._required_clearance(nearest_m - self._bodies_m)
        # farther obstacles change neither a term nor a contact
        self._keep_m = max(limits.clear_m, self._margin_m)
        self._yaw_rad = pose.yaw_rad
        self._chords: dict[float, list[tuple[float, float, float]]] = {}
        self._near: dict[float, tuple[list[Point], list[MovingObstacle]]] = {}

    def chords(self, w: float, times: list[float]) -> list[tuple[float, float, float]]:
        """Instants, each with the displacement until then at this yaw rate and a speed of 1 m/s."""
        found = self._chords.get(w)
        if found is None:
            found = [(time_s, *_chord(self._yaw_rad, w, time_s)) for time_s in times]
            self._chords[w] = found
        return found

    def near(self, travel_m: float) -> tuple[list[Point], list[MovingObstacle]]:
        """Obstacles that affect a term or a contact on a trajectory of this length."""
        found = self._near.get(travel_m)
        if found is None:
            limits = self._limits
            to_points = travel_m + limits.radius_m + self._keep_m
            to_movers = travel_m + self._bodies_m + self._keep_m
            found = self._near[travel_m] = (
                [point for gap, point in self._points if gap <= to_points],
                [
                    mover
                    for gap, mover in self._movers
                    if gap - math.hypot(mover.vx_m_s, mover.vy_m_s) * limits.horizon_s <= to_movers
                ],
            )
        return found

    def gaps_m(
        self, points: list[Point], movers: list[MovingObstacle], at: Point, time_s: float
    ) -> tuple[float, float]:
        """Clearance to the nearest point and to the nearest platform at an instant."""
        x, y = at
        to_points = to_movers = math.inf
        for px, py in points:
            dx, dy = x - px, y - py
            square = dx * dx + dy * dy
            to_points = min(to_points, square)
        for mover in movers:
            dx = x - (mover.x_m + mover.vx_m_s * time_s)
            dy = y - (mover.y_m + mover.vy_m_s * time_s)
            square = dx * dx + dy * dy
            to_movers = min(to_movers, square)
        return math.sqrt(to_points) - self._limits.radius_m, math.sqrt(to_movers) - self._bodies_m

    def touches(self, to_points_m: float, to_movers_m: float) -> bool:
        """True if a clearance is too small."""
        return to_points_m < self._to_points_m or to_movers_m < self._to_movers_m

    def _required_clearance(self, now_m: float) -> float:
        """Clearance to keep: the margin, or the present clearance if smaller, so that the vehicle can
        leave."""
        return min(self._margin_m, max(0.0, now_m - _MARGIN_NOISE_M))


def _spread(first: float, last: float, count: int) -> list[float]:
    """Returns `count` values at equal distances, including both ends."""
    step = (last - first) / (count - 1)
    return [*(index * step + first for index in range(count - 1)), last]


def _chord(yaw: float, w: float, time_s: float) -> Point:
    """Displacement after a time on an arc, for a speed of 1 m/s, in closed form."""
    if abs(w) < _STRAIGHT:
        return time_s * math.cos(yaw), time_s * math.sin(yaw)
    # chord of the arc: 1/ω · (sin(φ+ωt) − sin φ)
    turned = yaw + w * time_s
    return (math.sin(turned) - math.sin(yaw)) / w, (math.cos(yaw) - math.cos(turned)) / w
