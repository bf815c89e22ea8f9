"""The way around what stands in it: a free direction beside the wanted one.

The dynamic window only sees as far as its horizon and stops before what it meets head-on; a direction that is
free further out leads it past. Source: Ulrich, Borenstein: VFH+, reliable obstacle avoidance for fast mobile
robots, 1998 (its cost of a direction).
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmd.navigator.config import Dwa
from swarmd.navigator.core.target import Surroundings
from swarmware.types.vehicle import Pose

Array = NDArray[np.float64]

_TURNS: Final[Array] = np.radians(np.arange(-100.0, 101.0, 5.0))
"""Directions that are tried, seen from the wanted one."""
_WANTED: Final = 5.0
_HEADING: Final = 2.0
"""Prices of a radian away from the wanted direction and from the own heading: a vehicle that goes around one
side would otherwise find the other shorter half-way, and meet the middle."""
_CHANGE: Final = 2.6
"""Price of the other side, for the same reason: as much as half a radian."""
_SLOW_M_S: Final = 0.3
"""A platform slower than this stands in the way; a faster one will be gone."""
_OTHER_M: Final = 0.4
"""Radius taken for other platforms."""
_HEIGHT_M: Final = 1.5
_ROOM_M: Final = (0.1, 0.0)
"""Kept free beside radius and margin, or the planner would pass along its own limit; in a narrow gap none."""


class Detour:
    """Chooses the direction, and remembers the side on which it goes around."""

    __slots__ = ("_limits", "_side")

    def __init__(self, limits: Dwa) -> None:
        self._limits = limits
        self._side = 0.0

    def set_limits(self, limits: Dwa) -> None:
        """New limits, while driving."""
        self._limits = limits

    def aim(
        self, pose: Pose, ahead_m: tuple[float, float], reach_m: float, around: Surroundings
    ) -> tuple[float, float]:
        """The point to aim at: as far away as the wanted one, in a direction that is free for a reach."""
        dx, dy = ahead_m[0] - pose.x_m, ahead_m[1] - pose.y_m
        distance = math.hypot(dx, dy)
        things = self._things(pose, around)
        if distance < 1e-6 or not things:
            self._side = 0.0
            return ahead_m
        bearing = math.atan2(dy, dx)
        turn = self._turn(bearing, pose.yaw_rad, reach_m, np.array(things))
        if turn == 0.0:
            return ahead_m
        angle = bearing + turn
        return pose.x_m + distance * math.cos(angle), pose.y_m + distance * math.sin(angle)

    def _turn(self, bearing: float, yaw: float, reach_m: float, things: Array) -> float:
        """The cheapest free direction, seen from the wanted one; that one itself where none is free."""
        if _free(np.array([bearing]), math.inf, things, _ROOM_M[0])[0]:
            self._side = 0.0
            return 0.0
        angles = bearing + _TURNS
        off = np.abs((angles - yaw + np.pi) % math.tau - np.pi)
        price = _WANTED * np.abs(_TURNS) + _HEADING * off + _CHANGE * (np.sign(_TURNS) * self._side < 0)
        for room in _ROOM_M:
            free = _free(angles, reach_m, things, room)
            if free.any():
                turn = float(_TURNS[np.argmin(np.where(free, price, np.inf))])
                if turn:  # straight on is free for a short reach, too, in front of what it goes around
                    self._side = math.copysign(1.0, turn)
                return turn
        return 0.0

    def _things(self, pose: Pose, around: Surroundings) -> list[tuple[float, float, float]]:
        """What is near, seen from here, with the distance that the planner keeps from it."""
        width = self._limits.radius_m + self._limits.margin_m
        found = [(x - pose.x_m, y - pose.y_m, width) for x, y in around.points_m]
        found += [
            (n.x_m - pose.x_m, n.y_m - pose.y_m, width + _OTHER_M)
            for n in around.neighbours
            if math.hypot(n.vx_m_s, n.vy_m_s) < _SLOW_M_S and abs(n.z_m - pose.z_m) < _HEIGHT_M
        ]
        reach_m = self._limits.v_max_m_s * self._limits.horizon_s
        return [thing for thing in found if math.hypot(thing[0], thing[1]) < reach_m + thing[2]]


def _free(angles: Array, reach_m: float, things: Array, room_m: float) -> NDArray[np.bool_]:
    """Whether a strip in each direction holds nothing."""
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    dx, dy, width = things.T
    along = dx * cos + dy * sin
    answer: NDArray[np.bool_] = ~np.any(
        (along > 0.0) & (along < reach_m) & (np.abs(dy * cos - dx * sin) < width + room_m), axis=1
    )
    return answer
