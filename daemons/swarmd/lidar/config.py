"""Settings of the lidar (services/lidar.toml)."""

from typing import Annotated

import msgspec

Metres = Annotated[float, msgspec.Meta(ge=-1000, le=1000)]
Distance = Annotated[float, msgspec.Meta(gt=0, le=1000)]


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the packets come from, and what of the points is an obstacle."""

    packets: str = "sensor/lidar"
    """Stream of the packets of a Velodyne VLP-16, as a driver of `hal` writes it."""
    ranges: str = "sensor/range"
    """Board of the distances to obstacles, by which the navigator avoids them: of one driver only."""
    points: str = ""
    """Stream of the points of each turn; empty: none."""
    beams: Annotated[int, msgspec.Meta(ge=8, le=720)] = 36
    """Directions of the distances, around the vehicle; the first one is forward."""
    low_m: Metres = -0.5
    """Height above which points are obstacles, relative to the lidar: below is ground."""
    high_m: Metres = 1.5
    """Height below which points are obstacles: above, there is room."""
    near_m: Distance = 0.9
    """Points that are nearer belong to the vehicle."""
    max_m: Distance = 100.0
    """Distance of a direction without an obstacle."""
    echoes: Annotated[int, msgspec.Meta(ge=1, le=100)] = 3
    """Points of an obstacle in one direction: fewer are dust, rain or noise."""
    forward_deg: Annotated[float, msgspec.Meta(ge=0, lt=360)] = 0.0
    """Azimuth of the lidar that points forward, clockwise from above."""
