"""Packets of a Velodyne VLP-16 as the points of whole turns."""

import math
from collections.abc import Sequence
from types import ModuleType
from typing import Any, Final

import msgspec

from swarmware.errors import NotFound
from swarmware.model.record_filter import VLP16_PACKET

ELEVATIONS_DEG: Final = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
"""Elevation of each laser, in the order in which they fire (VLP-16 User Manual 63-9243, section 9.3.1.3)."""
_STEP_M: Final = 0.002
"""Unit of distances."""
_FLAG: Final = 0xEEFF
"""Begin of each block, little-endian."""
_BLOCKS, _BLOCK_BYTES = 12, 100
_TURN_CDEG: Final = 36_000
_POINTS_MAX: Final = 100_000
"""Points of one turn: three times those of 5 turns a second; more mean that its motor stands."""


def numpy() -> ModuleType:
    """The module NumPy. Raises: NotFound where it is not installed."""
    try:
        import numpy as found
    except ImportError:
        raise NotFound("the lidar needs NumPy: pip install 'swarmware[lidar]'") from None
    return found


class Turn(msgspec.Struct, frozen=True, gc=False):
    """The points of one turn."""

    stamp_ns: int
    """Instant of its last packet."""
    points: Any
    """Array of float32 with a row for each point: x, y, z in m, FLU of the lidar."""


class TurnDecoder:
    """Collects points until the azimuth passes that of the forward direction."""

    def __init__(self, forward_deg: float = 0.0) -> None:
        """Raises: NotFound without NumPy."""
        self._np: Any = numpy()
        self._forward_cdeg = round(forward_deg * 100)
        elevation = self._np.radians(self._np.array(ELEVATIONS_DEG, "f4"))
        self._level, self._up = self._np.cos(elevation), self._np.sin(elevation)
        self._parts: list[Any] = []
        self._count = 0
        self._last_cdeg = -1
        self.refused = 0
        """Packets of another length, and blocks without their flag."""

    def turns(self, packets: Sequence[bytes], stamp_ns: int) -> list[Turn]:
        """The turns that end in these packets; `stamp_ns`: instant of the last packet."""
        np = self._np
        whole = [packet for packet in packets if len(packet) == VLP16_PACKET]
        self.refused += len(packets) - len(whole)
        if not whole:
            return []
        rows = np.frombuffer(b"".join(whole), "u1").reshape(-1, VLP16_PACKET)[:, : _BLOCKS * _BLOCK_BYTES]
        blocks = np.ascontiguousarray(rows.reshape(-1, _BLOCK_BYTES))
        heads = blocks[:, :4].copy().view("<u2")
        good = (heads[:, 0] == _FLAG) & (heads[:, 1] < _TURN_CDEG)
        self.refused += int(len(good) - good.sum())
        blocks = blocks[good]
        if not len(blocks):
            return []
        # from the forward direction on, clockwise
        azimuths = (heads[good, 1].astype("i4") - self._forward_cdeg) % _TURN_CDEG
        before = np.concatenate(([self._last_cdeg], azimuths[:-1]))
        self._last_cdeg = int(azimuths[-1])
        steps = np.diff(azimuths) % _TURN_CDEG
        moving = steps[steps > 0]
        second = (np.median(moving) / 2 if len(moving) else 0.0) * math.pi / 18_000
        points = self._points(blocks, np.radians(azimuths / 100.0), float(second))
        found: list[Turn] = []
        begin = 0
        for end in np.flatnonzero(before - azimuths > _TURN_CDEG // 2):
            self._keep(points, begin, int(end))
            self._finish(found, stamp_ns)
            begin = int(end)
        self._keep(points, begin, len(blocks))
        if self._count > _POINTS_MAX:
            self._finish(found, stamp_ns)
        return found

    def _points(self, blocks: Any, azimuth_rad: Any, second_rad: float) -> Any:
        """Points by block, with those that were not reflected: (blocks, 32, 3)."""
        np = self._np
        lasers = blocks[:, 4:].reshape(-1, 2, 16, 3)
        distances = (lasers[..., 0] + lasers[..., 1].astype("u2") * 256) * np.float32(_STEP_M)
        azimuths = azimuth_rad[:, None] + np.array([0.0, second_rad])
        level = distances * self._level
        forward = level * np.cos(azimuths).astype("f4")[..., None]
        left = level * -np.sin(azimuths).astype("f4")[..., None]
        return np.stack([forward, left, distances * self._up], axis=-1).reshape(len(blocks), 32, 3)

    def _keep(self, points: Any, begin: int, end: int) -> None:
        part = points[begin:end].reshape(-1, 3)
        part = part[part.any(axis=1)]
        if len(part):
            self._parts.append(part)
            self._count += len(part)

    def _finish(self, found: list[Turn], stamp_ns: int) -> None:
        if self._parts:
            found.append(Turn(stamp_ns, self._np.concatenate(self._parts)))
        self._parts, self._count = [], 0
