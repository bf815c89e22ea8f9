"""The inputs of a controller: the target with its velocity, and the obstacles around."""

from typing import Final

import msgspec

PLATFORM_RADIUS_M: Final = 0.4
"""Assumed radius of other platforms."""
PLATFORM_HEIGHT_M: Final = 1.5
"""Vertical distance above which another platform is not an obstacle."""


class Target(msgspec.Struct, frozen=True, gc=False):
    """The position that the vehicle should have now, and how to reach it."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float | None
    """Commanded heading, or None for any heading."""
    speed_m_s: float
    """Maximum speed towards the target."""
    ahead_m: tuple[float, float]
    """Look-ahead point to which a ground vehicle steers."""
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Velocity of a moving target."""
    climb_m_s: float = 100.0
    """Maximum rate of climb and descent."""
    course_rad: float | None = None
    """Course on which a vehicle that cannot stop passes the target, or None to circle around it."""


class MovingObstacle(msgspec.Struct, frozen=True, gc=False):
    """Position and velocity of another platform at this instant."""

    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    yields: bool = False
    """True if the platform gives way; without this asymmetry two vehicles would block each other."""
    age_s: float = 0.0
    """Age of the pose from which its position was predicted."""


class Surroundings(msgspec.Struct, frozen=True):
    """Obstacles and platforms around the vehicle."""

    points_m: tuple[tuple[float, float], ...] = ()
    """Echoes of the scanner in map coordinates."""
    neighbours: tuple[MovingObstacle, ...] = ()
    delay_s: float = 0.0
    """Delay by which the next step may be late, during which the vehicle follows the present set-point."""
