"""Geofence of a vehicle: its state, and the origin of the map to which it refers."""

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.bounds import Finite
from swarmware.types.registry import register


class FenceLimit(OpenEnum):
    """Limit of a geofence."""

    NONE = ""
    AREA = "area"
    """The polygon or circle."""
    MIN_HEIGHT = "min_height"
    MAX_HEIGHT = "max_height"


@register
class MapOrigin(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Geodetic position of the map's origin (board `nav/origin`)."""

    lat_deg: Finite
    lon_deg: Finite
    alt_ellipsoid_m: Finite
    """Height above the ellipsoid, not above sea level."""


@register
class FenceState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Geofence of a vehicle, and where the vehicle is to it (board `nav/fence`)."""

    exists: bool
    """Whether the vehicle has a fence."""
    inside: bool | None = None
    """Whether the vehicle is within all limits, or None without a fence or a position."""
    leaving: bool | None = None
    """Whether the vehicle is outside, within the margin, or too fast to stop before a limit; None as
    `inside`."""
    distance_m: Finite | None = None
    """Distance to the nearest limit, positive inside; outside the negative distance to the worst limit."""
    limit: FenceLimit = FenceLimit.NONE
    """Nearest limit; outside the fence, the limit that is exceeded by the largest distance."""
    min_height_m: Finite | None = None
    """Lowest height above the map's origin."""
    max_height_m: Finite | None = None
    """Greatest height above the map's origin."""
    note: str = ""
    """Reason for which the fence is not known: no pose, or no origin of the map."""
