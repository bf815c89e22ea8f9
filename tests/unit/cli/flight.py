"""Log entries of a short flight."""

import math
import struct
from collections.abc import Iterator

import msgspec

from swarmware.recorder.entry import LogEntry
from swarmware.types import registry
from swarmware.types.health import Fault, Phase
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.scalar import Blob
from swarmware.types.vehicle import GnssFix, Imu, Pose, Range

UTC = 1_700_000_000_000_000_000


def entry(path: str, value: msgspec.Struct, number: int, kind: str = "board") -> LogEntry:
    name = type(value).__name__
    stamp, payload = 5 * number, registry.encode(value)
    sent = UTC + number - 1000
    return LogEntry(
        "uav1:hal:out", number, "uav1", path, kind, name, stamp, UTC + number, payload, sent_utc_ns=sent
    )


def packet() -> bytes:
    """One packet of a VLP-16: every laser at 10 m."""
    block = struct.pack("<HH", 0xEEFF, 9000) + struct.pack("<HB", 5000, 7) * 32
    return block * 12 + bytes(6)


def flight() -> Iterator[LogEntry]:
    yield entry("nav/pose", Pose.planar(1.0, 2.0, 3.0, yaw_rad=1.0), 1)
    yield entry("sim/truth", Pose(1.0, 2.0, 3.1), 2)
    yield entry("sensor/gnss", GnssFix(48.1, 11.5, math.nan, 0.5, 12), 3)
    yield entry("sensor/range", Range(0.0, math.pi / 2, 30.0, (1.0, 2.0, math.inf, 4.0)), 4)
    yield entry("sensor/lidar", Blob(packet()), 5, "stream")
    yield entry("sensor/camera", Blob(b"\xff\xd8\xff\xe0 picture"), 6, "stream")
    fault = Fault("battery", "low", "error", Phase.CONFIRMED, 1, 2, 1, "11.0 V", "Battery")
    yield entry("health/faults", fault, 7, "event")
    yield entry("sensor/imu", Imu(0.1, math.nan, 0.0, 0.0, 0.0, 9.8), 8)
    yield entry("nav/goal", Goal(1, GoalKind.FORMATION, offset_m=(1.0, 2.0, 3.0), course=((1.0, 2.0),)), 9)
