"""Conversion between WGS84 and the swarm's local map: east, north and up of an origin."""

import math
from typing import Final

import msgspec

from swarmware.errors import InvalidInput

SEMI_MAJOR_M: Final = 6_378_137.0
FLATTENING: Final = 1 / 298.257223563
"""Ellipsoid of WGS84 (NIMA TR8350.2, table 3.1)."""

GRAVITY_M_S2: Final = 9.80665
"""Standard gravity, by definition of the third CGPM (1901)."""
GNSS_HEIGHT_RATIO: Final = 1.5
"""Ratio of the vertical to the horizontal error of a GNSS fix, as all satellites are above the receiver."""
ORIGIN_ACC_M: Final = 10.0
"""Error of a fix above which no map begins there, typical of a dilution of two without corrections."""

_E2: Final = FLATTENING * (2 - FLATTENING)


class Origin(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Geodetic position of the local map's origin."""

    lat_deg: float = 0.0
    lon_deg: float = 0.0
    alt_ellipsoid_m: float = 0.0
    """Height above the ellipsoid, not above sea level."""

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) < 89.9 and abs(self.lon_deg) <= 180.0):
            raise InvalidInput("origin: expected lat_deg within ±89.9 and lon_deg within ±180")


class LocalMap:
    """Tangent plane at an origin: exact to a centimetre within a kilometre, to a metre within ten.

    Radii of curvature of the ellipsoid at the origin; the Earth's curve is added to the height. pymap3d is
    exact at any distance, and takes nine times as long for one point (3.2 and 0.4 µs); a vehicle converts
    each fix of its receiver, whose error exceeds the approximation's. A test holds the error
    against the exact transformation through Earth-centred coordinates.
    """

    __slots__ = ("_origin", "_per_lat_m", "_per_lon_m", "_tan_lat")

    def __init__(self, origin: Origin) -> None:
        lat = math.radians(origin.lat_deg)
        root = math.sqrt(1 - _E2 * math.sin(lat) ** 2)
        normal = SEMI_MAJOR_M / root
        meridian = SEMI_MAJOR_M * (1 - _E2) / root**3
        self._origin = origin
        self._per_lat_m = math.radians(meridian + origin.alt_ellipsoid_m)
        self._per_lon_m = math.radians((normal + origin.alt_ellipsoid_m) * math.cos(lat))
        self._tan_lat = math.tan(lat)

    def to_local(self, lat_deg: float, lon_deg: float, alt_ellipsoid_m: float) -> tuple[float, float, float]:
        """East, north and up in metres."""
        north = (lat_deg - self._origin.lat_deg) * self._per_lat_m
        turn = math.remainder(lon_deg - self._origin.lon_deg, 360.0)
        # meridians converge: a degree of longitude is shorter to the north
        east = turn * self._per_lon_m * (1 - self._tan_lat * north / SEMI_MAJOR_M)
        north += self._tan_lat * east * east / (2 * SEMI_MAJOR_M)
        # the surface falls away from the tangent plane: 8 cm at 1 km
        drop = (east * east + north * north) / (2 * SEMI_MAJOR_M)
        return east, north, alt_ellipsoid_m - self._origin.alt_ellipsoid_m - drop

    def to_wgs84(self, x_m: float, y_m: float, z_m: float) -> tuple[float, float, float]:
        """Latitude and longitude in degrees, height above the ellipsoid in metres."""
        drop = (x_m * x_m + y_m * y_m) / (2 * SEMI_MAJOR_M)
        north = y_m - self._tan_lat * x_m * x_m / (2 * SEMI_MAJOR_M)
        east = x_m / (1 - self._tan_lat * north / SEMI_MAJOR_M)
        return (
            self._origin.lat_deg + north / self._per_lat_m,
            math.remainder(self._origin.lon_deg + east / self._per_lon_m, 360.0),
            self._origin.alt_ellipsoid_m + z_m + drop,
        )
