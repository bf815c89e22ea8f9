"""What a pilot gets: where to be, how that place moves, what is around."""

import msgspec


class Target(msgspec.Struct, frozen=True, gc=False):
    """The place to be at now."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float | None
    """Heading to have there; None: as it comes."""
    speed_m_s: float
    """Not faster than this on the way."""
    ahead_m: tuple[float, float]
    """Point at which a ground vehicle aims."""
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How the place moves."""
    climb_m_s: float = 100.0
    """Neither climb nor sink faster than this."""


class Neighbour(msgspec.Struct, frozen=True, gc=False):
    """Another platform, now."""

    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    yields: bool = False
    """It gives way to us: of two that avoid each other in the same manner, neither would get past."""


class Surroundings(msgspec.Struct, frozen=True):
    """What must not be hit."""

    points_m: tuple[tuple[float, float], ...] = ()
    """Echoes of the scanner, in the map."""
    neighbours: tuple[Neighbour, ...] = ()


NOTHING_AROUND = Surroundings()
