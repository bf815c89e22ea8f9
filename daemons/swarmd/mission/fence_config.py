"""Settings of the geofence (table `fence` of services/mission.toml), checked when they are read."""

import math
from typing import Annotated, Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.geometry.polygon import Point, self_intersection

POINTS_MIN: Final = 3
LAT_MAX_DEG: Final = 89.9
"""The map is a tangent plane, which has no east at a pole."""

Height = Annotated[float, msgspec.Meta(ge=-100_000, le=100_000)]
Distance = Annotated[float, msgspec.Meta(ge=0, le=100_000)]
Metres = Annotated[float, msgspec.Meta(ge=-1_000_000, le=1_000_000)]
Degrees = Annotated[float, msgspec.Meta(ge=-180, le=180)]


class FenceConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Area and heights that the vehicle must not leave: at most one area, or heights alone."""

    polygon_m: tuple[tuple[Metres, Metres], ...] = ()
    """Corners of the area in the map: east, north."""
    polygon_deg: tuple[tuple[Degrees, Degrees], ...] = ()
    """Corners of the area: latitude, longitude (WGS84)."""
    centre_m: tuple[Metres, Metres] | None = None
    """Centre of a circle in the map: east, north."""
    centre_deg: tuple[Degrees, Degrees] | None = None
    """Centre of a circle: latitude, longitude (WGS84)."""
    radius_m: Annotated[float, msgspec.Meta(gt=0, le=100_000)] | None = None
    """Radius of the circle."""
    min_height_m: Height | None = None
    """Lowest height above the map's origin, of a vehicle in the air."""
    max_height_m: Height | None = None
    """Greatest height above the map's origin."""
    margin_m: Distance = 0.0
    """Distance from a limit within which a target is refused, and a vehicle counts as leaving."""

    def __post_init__(self) -> None:
        """Check each shape, and that area, circle and heights agree."""
        names = ("polygon_m", "polygon_deg", "centre_m", "centre_deg")
        areas = [name for name in names if getattr(self, name)]
        if len(areas) > 1:
            raise InvalidInput(f"key {areas[1]}: {areas[0]} is given too; expected one area")
        circle = self.centre_m is not None or self.centre_deg is not None
        if circle is not (self.radius_m is not None):
            missing = "radius_m" if circle else "centre_m or centre_deg"
            raise InvalidInput(f"key {missing}: missing; expected centre and radius of a circle")
        low, high = self.min_height_m, self.max_height_m
        if not areas and low is None and high is None:
            raise InvalidInput(
                f"neither an area nor heights; expected one of {', '.join(names)}, min_height_m, max_height_m"
            )
        if low is not None and high is not None and not low < high:
            raise InvalidInput(f"key min_height_m: {low:g} is not below max_height_m ({high:g})")
        _check_polygon("polygon_m", self.polygon_m)
        for index, (lat_deg, _) in enumerate(self.polygon_deg):
            _check_latitude(f"polygon_deg, corner {index + 1}", lat_deg)
        # checked in the plane of degrees: the origin of the map is not known here
        _check_polygon("polygon_deg", _planar(self.polygon_deg))
        if self.centre_deg is not None:
            _check_latitude("centre_deg", self.centre_deg[0])


def _check_latitude(key: str, lat_deg: float) -> None:
    if abs(lat_deg) > LAT_MAX_DEG:
        raise InvalidInput(
            f"key {key}: latitude {lat_deg:g}; expected [latitude, longitude] within ±{LAT_MAX_DEG}"
        )


def _check_polygon(key: str, corners: tuple[Point, ...]) -> None:
    if not corners:
        return
    if len(corners) < POINTS_MIN:
        raise InvalidInput(f"key {key}: {len(corners)} corners; expected {POINTS_MIN} at least")
    found = self_intersection(corners)
    if found is None:
        return
    first, second = found
    count = len(corners)
    if first == second:
        raise InvalidInput(
            f"key {key}: corners {first + 1} and {(first + 1) % count + 1} are the same place;"
            " expected each once"
        )
    text = " and ".join(f"from corner {edge + 1} to {(edge + 1) % count + 1}" for edge in found)
    raise InvalidInput(f"key {key}: the edges {text} meet; expected a boundary that does not cross itself")


def _planar(corners: tuple[Point, ...]) -> tuple[Point, ...]:
    """Degrees as a plane: longitudes relative to the first, so that the antimeridian does not cut it."""
    return tuple((math.remainder(lon - corners[0][1], 360.0), lat) for lat, lon in corners)
