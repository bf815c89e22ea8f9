"""Entries as messages with the schemas that the panels of Foxglove know: map, 3D, log, image.

`share/swarm/schemas/foxglove` has these schemas.
"""

import base64
import math
import struct
from array import array
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import msgspec

from swarmctl.resources.values import brief
from swarmware.geometry.geodesy import LocalMap
from swarmware.recorder.entry import LogEntry
from swarmware.types.health import Fault, Phase
from swarmware.types.log import LogGap
from swarmware.types.navigation import Collision
from swarmware.types.scalar import Blob
from swarmware.types.vehicle import GnssFix, MotorOrder, Pose, Range

PREFIX: Final = "/foxglove"
"""Topics of these messages begin with it: `/foxglove/uav1/nav/pose`."""
MAP: Final = "map"
"""Frame of the poses: ENU."""
_POSE: Final = "nav/pose"
"""Resource that moves the frame of a platform; others are displayed in the map."""
_MAP_M: Final = 100_000.0
"""Distance from the origin beyond which the local map deviates from the Earth's surface."""
_INFO, _WARNING, _ERROR = 2, 3, 4
_LEVELS: Final = {"ok": _INFO, "warn": _WARNING, "error": _ERROR}
_UNKNOWN, _APPROXIMATED = 0, 1
_FLOAT32: Final = 7
_IMAGES: Final = ((b"\xff\xd8\xff", "jpeg"), (b"\x89PNG", "png"))
_LAST_SEC: Final = (1 << 32) - 1
"""Seconds of a stamp have 32 bits. Source: foxglove.Time."""
_REPORTED: Final = frozenset({"event", "command"})

_PACKET_BYTES: Final = 1206
_BLOCKS: Final = 12
_BLOCK: Final = struct.Struct("<HH" + 32 * "HB")
_BLOCK_FLAG: Final = 0xEEFF
_RANGE_M: Final = 0.002
_ELEVATION_DEG: Final = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
"""Of the 16 lasers. Source: VLP-16 user manual, section 9; all points of a block have its azimuth."""


class PanelMessage(NamedTuple):
    """One message for a panel."""

    topic: str
    schema: str
    """`foxglove.PoseInFrame`: also the name of the file with the schema."""
    content: dict[str, Any]


def panel_messages(entry: LogEntry, local: LocalMap | None = None) -> Iterator[PanelMessage]:
    """Messages that show an entry; none for most types. `local`: the map of its platform, when known."""
    value = entry.value()
    stamp = _time(entry.sent_utc_ns or entry.utc_ns)
    topic = PREFIX + entry.topic
    if isinstance(value, Pose):
        yield from _pose(entry, value, stamp)
        if entry.path == _POSE and local is not None and math.hypot(value.x_m, value.y_m) < _MAP_M:
            fix = GnssFix(*local.to_wgs84(value.x_m, value.y_m, value.z_m), math.nan, 0)
            content = _location(entry.platform, fix, stamp)
            yield PanelMessage(f"{topic}/location", "foxglove.LocationFix", content)
    elif isinstance(value, GnssFix) and math.isfinite(value.lat_deg + value.lon_deg):
        yield PanelMessage(topic, "foxglove.LocationFix", _location(entry.platform, value, stamp))
    elif isinstance(value, Range):
        points = _scan(value)
        yield PanelMessage(topic, "foxglove.PointCloud", _cloud(entry.platform, points, stamp))
    elif isinstance(value, Blob):
        yield from _blob(entry, value.value, stamp)
    if entry.kind in _REPORTED:
        content = {
            "timestamp": stamp,
            "level": _level(value),
            "message": _text(entry, value),
            "name": entry.topic,
            "file": entry.sender,
            "line": entry.sequence,
        }
        yield PanelMessage(f"{PREFIX}/log", "foxglove.Log", content)


def _time(utc_ns: int) -> dict[str, int]:
    sec, nsec = divmod(max(0, utc_ns), 1_000_000_000)
    return {"sec": min(sec, _LAST_SEC), "nsec": nsec}


def _pose(entry: LogEntry, pose: Pose, stamp: dict[str, int]) -> Iterator[PanelMessage]:
    place = {"x": pose.x_m, "y": pose.y_m, "z": pose.z_m}
    turn = {"x": pose.qx, "y": pose.qy, "z": pose.qz, "w": pose.qw}
    content = {"timestamp": stamp, "frame_id": MAP, "pose": {"position": place, "orientation": turn}}
    yield PanelMessage(PREFIX + entry.topic, "foxglove.PoseInFrame", content)
    if entry.path == _POSE:
        frames = {"parent_frame_id": MAP, "child_frame_id": entry.platform}
        moved = {"timestamp": stamp, **frames, "translation": place, "rotation": turn}
        yield PanelMessage(f"{PREFIX}/tf", "foxglove.FrameTransform", moved)


def _location(platform: str, fix: GnssFix, stamp: dict[str, int]) -> dict[str, Any]:
    known = math.isfinite(fix.h_acc_m)
    variance = fix.h_acc_m**2 if known else 0.0
    return {
        "timestamp": stamp,
        "frame_id": platform,
        "latitude": fix.lat_deg,
        "longitude": fix.lon_deg,
        "altitude": fix.alt_ellipsoid_m if math.isfinite(fix.alt_ellipsoid_m) else 0.0,
        "position_covariance": [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, 0.0],
        "position_covariance_type": _APPROXIMATED if known else _UNKNOWN,
    }


def _scan(scan: Range) -> "array[float]":
    points = array("f")
    for index, range_m in enumerate(scan.ranges_m):
        # 0 and the maximum mean that there was no echo
        if 0 < range_m < scan.max_m:
            angle = scan.angle_min_rad + index * scan.angle_step_rad
            points.extend((range_m * math.cos(angle), range_m * math.sin(angle), 0.0))
    return points


def _cloud(frame: str, points: "array[float]", stamp: dict[str, int]) -> dict[str, Any]:
    size = points.itemsize
    # Foxglove reads little-endian numbers
    if struct.pack("=H", 1) != struct.pack("<H", 1):
        points.byteswap()
    return {
        "timestamp": stamp,
        "frame_id": frame,
        "pose": {
            "position": {"x": 0.0, "y": 0.0, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        },
        "point_stride": 3 * size,
        "fields": [{"name": name, "offset": size * at, "type": _FLOAT32} for at, name in enumerate("xyz")],
        "data": base64.b64encode(points.tobytes()).decode(),
    }


def _blob(entry: LogEntry, data: bytes, stamp: dict[str, int]) -> Iterator[PanelMessage]:
    topic = PREFIX + entry.topic
    for magic, form in _IMAGES:
        if data.startswith(magic):
            content = {"timestamp": stamp, "frame_id": entry.platform, "format": form}
            content["data"] = base64.b64encode(data).decode()
            yield PanelMessage(topic, "foxglove.CompressedImage", content)
    if len(data) == _PACKET_BYTES and data.startswith(_BLOCK_FLAG.to_bytes(2, "little")):
        yield PanelMessage(topic, "foxglove.PointCloud", _cloud(entry.platform, _packet(data), stamp))


def _packet(data: bytes) -> "array[float]":
    """Points of one packet of a VLP-16: x forward, y left."""
    points = array("f")
    for block in range(_BLOCKS):
        flag, azimuth, *returns = _BLOCK.unpack_from(data, block * _BLOCK.size)
        if flag != _BLOCK_FLAG:
            continue
        angle = math.radians(azimuth / 100)
        for laser, distance in enumerate(returns[::2]):
            if distance:
                elevation = math.radians(_ELEVATION_DEG[laser % 16])
                level_m = distance * _RANGE_M * math.cos(elevation)
                height_m = distance * _RANGE_M * math.sin(elevation)
                # the azimuth of a VLP-16 is clockwise, so y to the left is negative
                points.extend((level_m * math.cos(angle), -level_m * math.sin(angle), height_m))
    return points


def _level(value: msgspec.Struct | None) -> int:
    match value:
        case Fault():
            return _LEVELS[value.level] if value.phase in (Phase.PENDING, Phase.CONFIRMED) else _INFO
        case Collision():
            return _ERROR
        case LogGap():
            return _WARNING
        case MotorOrder() if value.refused:
            return _WARNING
    return _INFO


def _text(entry: LogEntry, value: msgspec.Struct | None) -> str:
    if isinstance(value, Fault):
        return f"{value.check} {value.state} ({value.phase}): {value.what}"
    return f"{entry.type} {brief(entry.plain())}"
