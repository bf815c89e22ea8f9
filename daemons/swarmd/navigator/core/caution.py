"""Speed limit towards platforms with old positions, so that the vehicle never covers the gap unseen."""

import math
from typing import Final

import msgspec

from swarmd.navigator.core.target import PLATFORM_HEIGHT_M, PLATFORM_RADIUS_M, MovingObstacle, Surroundings
from swarmware.types.vehicle import Pose, Setpoint

FRESH_S: Final = 0.5
"""Age of a position up to which the avoidance of the controllers suffices; without overload of processors and
channels, poses are at most 0.3 s old."""
MARGIN_M: Final = 0.2
"""Minimum distance between two bodies."""
_NO_SPEED_M_S: Final = 1e-3


def cautious(setpoint: Setpoint, pose: Pose, around: Surroundings, *, flies: bool) -> Setpoint:
    """Limits a set-point so that the vehicle cannot reach any platform before its next known position.

    The time without a known position is its age plus the delay of the next step, `around.delay_s`.
    """
    cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    vx = setpoint.vx_m_s * cos - setpoint.vy_m_s * sin
    vy = setpoint.vx_m_s * sin + setpoint.vy_m_s * cos
    share = min(
        (_share(one, pose, vx, vy, one.age_s + around.delay_s) for one in around.neighbours), default=1.0
    )
    if share >= 1.0:
        return setpoint
    slower = msgspec.structs.replace(setpoint, vx_m_s=setpoint.vx_m_s * share, vy_m_s=setpoint.vy_m_s * share)
    if flies:
        return slower
    # a ground vehicle slows down on the same arc
    return msgspec.structs.replace(slower, wz_rad_s=setpoint.wz_rad_s * share)


def _share(other: MovingObstacle, pose: Pose, vx: float, vy: float, blind_s: float) -> float:
    """Ratio of the velocity that is admissible with regard to one platform."""
    if blind_s <= FRESH_S or abs(other.z_m - pose.z_m) >= PLATFORM_HEIGHT_M:
        return 1.0
    dx, dy = other.x_m - pose.x_m, other.y_m - pose.y_m
    away_m = max(math.hypot(dx, dy), 1e-3)
    # only motion towards the platform is limited
    closing_m_s = (vx * dx + vy * dy) / away_m
    if closing_m_s <= _NO_SPEED_M_S:
        return 1.0
    # a platform that approaches takes its part of the gap
    its_m_s = -(other.vx_m_s * dx + other.vy_m_s * dy) / away_m
    room_m = away_m - 2 * PLATFORM_RADIUS_M - MARGIN_M - max(its_m_s, 0.0) * blind_s
    return min(max(room_m, 0.0) / (closing_m_s * blind_s), 1.0)
