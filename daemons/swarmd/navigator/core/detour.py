"""The way around what stands in it: a free direction beside the wanted one.

The dynamic window only sees as far as its horizon and stops before what it meets head-on; a direction that is
free further out leads it past. Source: Borenstein, Koren: The vector field histogram, 1991 (its last step).
"""

import math
from typing import Final

from swarmd.navigator.config import Dwa
from swarmd.navigator.core.target import Surroundings
from swarmware.types.vehicle import Pose

_STEP_RAD: Final = math.radians(10)
_MOST: Final = 10
"""Directions tried on each side: up to 100 degrees away."""
_CHANGE: Final = 3.0
"""Steps by which the other side must be better: a vehicle that changes its mind hits the middle."""
_SLOW_M_S: Final = 0.3
"""A platform slower than this stands in the way; a faster one will be gone."""
_OTHER_M: Final = 0.4
"""Radius taken for other platforms."""
_HEIGHT_M: Final = 1.5
_ROOM_M: Final = 0.1
"""Kept free beside radius and margin: the planner would otherwise pass along its own limit."""


class Detour:
    """Chooses the direction, and remembers the side on which it goes around."""

    __slots__ = ("_limits", "_side")

    def __init__(self, limits: Dwa) -> None:
        self._limits = limits
        self._side = 0

    def set_limits(self, limits: Dwa) -> None:
        """New limits, while driving."""
        self._limits = limits

    def aim(
        self, pose: Pose, ahead_m: tuple[float, float], reach_m: float, around: Surroundings
    ) -> tuple[float, float]:
        """The point to aim at: as far away as the wanted one, in a direction that is free for a reach."""
        dx, dy = ahead_m[0] - pose.x_m, ahead_m[1] - pose.y_m
        distance = math.hypot(dx, dy)
        things = self._things(pose, reach_m, around)
        if distance < 1e-6 or not things:
            self._side = 0
            return ahead_m
        bearing = math.atan2(dy, dx)
        best, best_price = 0, math.inf
        for turn in range(-_MOST, _MOST + 1):
            side = (turn > 0) - (turn < 0)
            price = abs(turn) + (_CHANGE if side * self._side < 0 else 0.0)
            if price < best_price and _free(bearing + turn * _STEP_RAD, reach_m, things):
                best, best_price = turn, price
        if math.isinf(best_price):
            return ahead_m
        if best:  # straight on is free for a short reach, too, in front of what it goes around
            self._side = (best > 0) - (best < 0)
        angle = bearing + best * _STEP_RAD
        return pose.x_m + distance * math.cos(angle), pose.y_m + distance * math.sin(angle)

    def _things(self, pose: Pose, reach_m: float, around: Surroundings) -> list[tuple[float, float, float]]:
        """What is near, seen from here, with the distance to keep from it."""
        width = self._limits.radius_m + self._limits.margin_m + _ROOM_M
        found = [(x - pose.x_m, y - pose.y_m, width) for x, y in around.points_m]
        found += [
            (n.x_m - pose.x_m, n.y_m - pose.y_m, width + _OTHER_M)
            for n in around.neighbours
            if math.hypot(n.vx_m_s, n.vy_m_s) < _SLOW_M_S and abs(n.z_m - pose.z_m) < _HEIGHT_M
        ]
        return [thing for thing in found if math.hypot(thing[0], thing[1]) < reach_m + thing[2]]


def _free(angle: float, reach_m: float, things: list[tuple[float, float, float]]) -> bool:
    """Whether a strip in this direction holds nothing."""
    cos, sin = math.cos(angle), math.sin(angle)
    for dx, dy, width in things:
        along = dx * cos + dy * sin
        if 0.0 < along < reach_m and abs(dy * cos - dx * sin) < width:
            return False
    return True
