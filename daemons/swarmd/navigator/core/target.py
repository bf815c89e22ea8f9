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
    """Commanded heading; None: any."""
    speed_m_s: float
    """Maximum speed."""
    ahead_m: tuple[float, float]
    """Look-ahead point to which a ground vehicle steers."""
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Velocity of the target."""
    climb_m_s: float = 100.0
    """Maximum rate of climb and descent."""
    course_rad: float | None = None
    """Course on which a vehicle that cannot stop passes the target; None: it circles around it."""


class MovingObstacle(msgspec.Struct, frozen=True, gc=False):
    """Another platform: its position and velocity at this instant."""

    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    yields: bool = False
    """Whether it gives way to this vehicle: two vehicles with the same rule would block each other."""
    age_s: float = 0.0
    """Age of the pose from which its position was predicted."""


class Surroundings(msgspec.Struct, frozen=True):
    """Obstacles around the vehicle."""

    points_m: tuple[tuple[float, float], ...] = ()
    """Echoes of the scanner in map coordinates."""
    neighbours: tuple[MovingObstacle, ...] = ()
    delay_s: float = 0.0
    """Time by which the next step may be late: until then the vehicle moves as this one decides."""
