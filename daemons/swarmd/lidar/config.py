"""Settings of the lidar (services/lidar.toml)."""

from typing import Annotated

import msgspec

Metres = Annotated[float, msgspec.Meta(ge=-1000, le=1000)]
Distance = Annotated[float, msgspec.Meta(gt=0, le=1000)]


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Source of the packets, and the criteria by which a point counts as an obstacle."""

    packets: str = "sensor/lidar"
    """Stream of the packets of a Velodyne VLP-16, as a driver of `hal` writes it."""
    ranges: str = "sensor/range"
    """Board of the distances to obstacles, which the navigator reads; only one driver may write it."""
    points: str = ""
    """Stream of the points of each turn, or "" to publish no points."""
    beams: Annotated[int, msgspec.Meta(ge=8, le=720)] = 36
    """Number of directions around the vehicle with a distance; the first direction is forward."""
    low_m: Metres = -0.5
    """Lower limit of the height of obstacles, relative to the lidar; lower points belong to the ground."""
    high_m: Metres = 1.5
    """Upper limit of the height of obstacles, relative to the lidar; the vehicle passes below higher
    points."""
    near_m: Distance = 0.9
    """Minimum distance of an obstacle; nearer points belong to the vehicle itself."""
    max_m: Distance = 100.0
    """Distance that is published for a direction without an obstacle."""
    echoes: Annotated[int, msgspec.Meta(ge=1, le=100)] = 3
    """Minimum number of points of an obstacle in one direction; fewer points are dust, rain or noise."""
    forward_deg: Annotated[float, msgspec.Meta(ge=0, lt=360)] = 0.0
    """Azimuth, in the lidar's axes, of the vehicle's forward direction; clockwise from above."""
