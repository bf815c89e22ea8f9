"""Decoder of Velodyne VLP-16 packets: collects the points of whole turns."""

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
"""Resolution of the distances in a packet (VLP-16 User Manual)."""
_FLAG: Final = 0xEEFF
"""First two bytes of each block, little-endian."""
_BLOCKS, _BLOCK_BYTES = 12, 100
_TURN_CDEG: Final = 36_000
_POINTS_MAX: Final = 100_000
"""Maximum points of one turn, three times the number at 5 turns a second; more come from a stopped motor."""


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
    """Instant of the last packet of the turn."""
    points: Any
    """Array of float32 with a row x, y, z in m for each point, in the lidar's FLU axes."""


class TurnDecoder:
    """Collects points until the azimuth passes the forward direction, where a turn ends."""

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
        """Number of packets of another length and of blocks without the flag."""

    def turns(self, packets: Sequence[bytes], stamp_ns: int) -> list[Turn]:
        """Turns that end in these packets; `stamp_ns` is the instant of the last packet."""
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
        # azimuths count clockwise from the forward direction
        azimuths = (heads[good, 1].astype("i4") - self._forward_cdeg) % _TURN_CDEG
        before = np.concatenate(([self._last_cdeg], azimuths[:-1]))
        self._last_cdeg = int(azimuths[-1])
        steps = np.diff(azimuths) % _TURN_CDEG
        moving = steps[steps > 0]
        # a block has two firings and the azimuth of the first; the second is half a block's step further
        second = (np.median(moving) / 2 if len(moving) else 0.0) * math.pi / 18_000
        points = self._points(blocks, np.radians(azimuths / 100.0), float(second))
        found: list[Turn] = []
        begin = 0
        # a large drop of the azimuth is the passage of the forward direction; a small one is jitter
        for end in np.flatnonzero(before - azimuths > _TURN_CDEG // 2):
            self._keep(points, begin, int(end))
            self._finish(found, stamp_ns)
            begin = int(end)
        self._keep(points, begin, len(blocks))
        if self._count > _POINTS_MAX:
            self._finish(found, stamp_ns)
        return found

    def _points(self, blocks: Any, azimuth_rad: Any, second_rad: float) -> Any:
        """Points of all blocks, shape (blocks, 32, 3); a point without a reflection is at 0, 0, 0."""
        np = self._np
        lasers = blocks[:, 4:].reshape(-1, 2, 16, 3)
        distances = (lasers[..., 0] + lasers[..., 1].astype("u2") * 256) * np.float32(_STEP_M)
        azimuths = azimuth_rad[:, None] + np.array([0.0, second_rad])
        level = distances * self._level
        forward = level * np.cos(azimuths).astype("f4")[..., None]
        # azimuths are clockwise, the axis y points to the left
        left = level * -np.sin(azimuths).astype("f4")[..., None]
        return np.stack([forward, left, distances * self._up], axis=-1).reshape(len(blocks), 32, 3)

    def _keep(self, points: Any, begin: int, end: int) -> None:
        part = points[begin:end].reshape(-1, 3)
        # removes points without a reflection
        part = part[part.any(axis=1)]
        if len(part):
            self._parts.append(part)
            self._count += len(part)

    def _finish(self, found: list[Turn], stamp_ns: int) -> None:
        if self._parts:
            found.append(Turn(stamp_ns, self._np.concatenate(self._parts)))
        self._parts, self._count = [], 0
