"""Images and point clouds of sensors: large values, which channels compress."""

from typing import Annotated

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.model.record_filter import NO_RECORDS, Layout, Records
from swarmware.types.bounds import Uint16
from swarmware.types.registry import register


class ImageEncoding(OpenEnum):
    """Meaning of the bytes of an image."""

    MONO8 = "mono8"
    """A byte for each pixel, row by row from above."""
    RGB8 = "rgb8"
    """Three bytes for each pixel: red, green, blue."""
    JPEG = "jpeg"
    """A JPEG file."""


@register
class Image(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One picture of a camera, as pixels or as JPEG."""

    width: Uint16
    height: Uint16
    encoding: ImageEncoding
    data: bytes


@register
class PointField(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One number of each point."""

    name: str
    """`x`, `y`, `z` in m, FLU of the sensor; `intensity`, `ring`, `time_s`."""
    offset: Uint16
    """Bytes from the begin of the point."""
    format: Annotated[str, msgspec.Meta(pattern=r"^[iuf][1248]$")]
    """Integer, unsigned integer or float, little-endian, and its bytes: `f4`, `u2`."""


@register
class PointCloud(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Points of a lidar, sonar or depth camera."""

    fields: tuple[PointField, ...]
    point_bytes: Uint16
    """From one point to the next."""
    points: bytes

    @property
    def records(self) -> Records:
        """The points, for compression."""
        if not self.point_bytes:
            return NO_RECORDS
        return Records(Layout.RECORDS, self.point_bytes, len(self.points))
