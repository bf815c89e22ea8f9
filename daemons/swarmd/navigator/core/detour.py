"""Detour around an obstacle, in a free direction next to the commanded direction.

The dynamic window reaches only to its horizon and stops in front of an obstacle met head-on; a direction that
is free beyond the horizon leads past. Source: Ulrich, Borenstein: VFH+, reliable obstacle avoidance for fast
mobile robots, 1998 (its cost of a direction).
"""

import math
from typing import Final

from swarmd.navigator.config import DwaConfig
from swarmd.navigator.core.target import PLATFORM_HEIGHT_M, PLATFORM_RADIUS_M, Surroundings
from swarmware.types.vehicle import Pose

Things = list[tuple[float, float, float]]

_TURNS: Final = tuple(math.radians(degrees) for degrees in range(-100, 101, 5))
"""Candidate directions, relative to the commanded direction."""
_WANTED: Final = 5.0
_HEADING: Final = 2.0
"""Costs per radian of deviation from the commanded direction and from the own heading. Without the second
cost a vehicle halfway around an obstacle would change the side, and hit the middle."""
_CHANGE: Final = 2.6
"""Cost of changing the side on which an obstacle is passed, equal to half a radian."""
_SLOW_M_S: Final = 0.3
"""Speed below which a platform counts as an obstacle; a faster platform will have left."""
_ROOM_M: Final = (0.1, 0.0)
"""Clearances beyond radius and margin, tried in this order; the second fits through a narrow gap."""


class Detour:
    """Chooses the direction, and keeps the side on which the vehicle passes an obstacle."""

    __slots__ = ("_limits", "_side")

    def __init__(self, limits: DwaConfig) -> None:
        self._limits = limits
        self._side = 0.0

    def set_limits(self, limits: DwaConfig) -> None:
        """Replaces the limits, also while driving."""
        self._limits = limits

    def aim(
        self, pose: Pose, ahead_m: tuple[float, float], reach_m: float, around: Surroundings
    ) -> tuple[float, float]:
        """The point to steer to, as far as the commanded point, in a direction that is free up to
        `reach_m`."""
        dx, dy = ahead_m[0] - pose.x_m, ahead_m[1] - pose.y_m
        distance = math.hypot(dx, dy)
        things = self._obstacles(pose, around)
        # without an obstacle the side is open again for the next one
        if distance < 1e-6 or not things:
            self._side = 0.0
            return ahead_m
        bearing = math.atan2(dy, dx)
        turn = self._turn(bearing, pose.yaw_rad, reach_m, things)
        if turn == 0.0:
            return ahead_m
        angle = bearing + turn
        return pose.x_m + distance * math.cos(angle), pose.y_m + distance * math.sin(angle)

    def _turn(self, bearing: float, yaw: float, reach_m: float, things: Things) -> float:
        """The free direction of minimum cost, relative to the commanded direction, or 0 if no direction is
        free."""
        if _is_free(bearing, math.inf, things, _ROOM_M[0]):
            self._side = 0.0
            return 0.0
        # by cost, so that the first free direction is the best
        turns = sorted(_TURNS, key=lambda turn: self._cost(turn, bearing + turn - yaw))
        for room in _ROOM_M:
            for turn in turns:
                if _is_free(bearing + turn, reach_m, things, room):
                    if turn:  # with a short reach, straight on may be free in front of the obstacle
                        self._side = math.copysign(1.0, turn)
                    return turn
        return 0.0

    def _cost(self, turn: float, off_heading: float) -> float:
        off = abs((off_heading + math.pi) % math.tau - math.pi)
        return _WANTED * abs(turn) + _HEADING * off + _CHANGE * (turn * self._side < 0)

    def _obstacles(self, pose: Pose, around: Surroundings) -> Things:
        """Near obstacles, as relative position and the distance that the planner keeps."""
        width = self._limits.radius_m + self._limits.margin_m
        found = [(x - pose.x_m, y - pose.y_m, width) for x, y in around.points_m]
        found += [
            (n.x_m - pose.x_m, n.y_m - pose.y_m, width + PLATFORM_RADIUS_M)
            for n in around.neighbours
            if math.hypot(n.vx_m_s, n.vy_m_s) < _SLOW_M_S and abs(n.z_m - pose.z_m) < PLATFORM_HEIGHT_M
        ]
        reach_m = self._limits.v_max_m_s * self._limits.horizon_s
        return [thing for thing in found if math.hypot(thing[0], thing[1]) < reach_m + thing[2]]


def _is_free(angle: float, reach_m: float, things: Things, room_m: float) -> bool:
    """True if a strip in a direction is free of obstacles."""
    cos, sin = math.cos(angle), math.sin(angle)
    for dx, dy, width in things:
        if 0.0 < dx * cos + dy * sin < reach_m and abs(dy * cos - dx * sin) < width + room_m:
            return False
    return True
