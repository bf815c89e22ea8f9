"""A tap into one resource's ring: takes what is to be logged out of shared memory."""

from pathlib import Path
from typing import Final

from swarmd.logger.core import Track
from swarmware import frame as wire
from swarmware.errors import SwarmError, WireError
from swarmware.frame import Codec, Frame
from swarmware.shm.layout import ring_file
from swarmware.shm.ring import RingReader
from swarmware.shm.ringfile import absent
from swarmware.types import registry

LOOK_NS: Final = 500_000_000
"""A ring that is not there is looked for this often, and when applications come or go."""


class Tap:
    """Reads one ring; opens it when it appears, and again when its writer moved it.

    `after_ns`: frames up to this stamp are logged already, by this logger before it was restarted.
    """

    def __init__(self, shm_dir: Path, track: Track, after_ns: int | None) -> None:
        self.track = track
        self._path = ring_file(shm_dir, track.path)
        self._name = str(self._path)
        self._after_ns = after_ns
        self._ring: RingReader | None = None
        self._lost = 0
        self._look_ns = 0

    def still(self, now_ns: int) -> bool:
        """Whether there cannot be anything new: the ring shows it, or was missed a moment ago."""
        ring = self._ring
        if ring is not None:
            at = ring.position if self.track.every else ring.seen
            return ring.sequence == at and not ring.moved
        if now_ns < self._look_ns:
            return True
        self._look_ns = now_ns + LOOK_NS
        return False

    def look_again(self) -> None:
        """A ring that was missing may be there now."""
        self._look_ns = 0

    def newest(self) -> Frame | None:
        """The newest frame, when it is another one than last time."""
        ring = self._open()
        if ring is None or ring.sequence == ring.seen:
            return None
        data = ring.newest()
        frame = _decoded(data) if data is not None else None
        return None if frame is None or self._known(frame) else frame

    def all(self) -> tuple[list[Frame], int]:
        """Every frame since last time, in order, and how many were overwritten before they were read."""
        ring = self._open()
        if ring is None:
            return [], 0
        frames: list[Frame] = []
        while (data := ring.next()) is not None:
            if (frame := _decoded(data)) is not None:
                frames.append(frame)
        lost, self._lost = ring.lost - self._lost, ring.lost
        fresh = [frame for frame in frames if not self._known(frame)]
        if len(fresh) < len(frames):
            lost = 0  # what went before a frame that is logged already is logged too
        elif fresh:
            self._after_ns = None
        return fresh, lost

    def _known(self, frame: Frame) -> bool:
        return self._after_ns is not None and frame.stamp_ns <= self._after_ns

    def _open(self) -> RingReader | None:
        if self._ring is None and absent(self._name):
            return None
        try:
            if self._ring is None:
                # from the first frame that is still there: events may be older than this logger
                self._ring = RingReader(self._path, after=0)
            elif self._ring.moved and self._ring.sequence in (self._ring.position, self._ring.seen):
                self._ring = self._ring.reopen()  # what the old file held was taken
        except SwarmError:
            return self._ring  # no writer yet, or none any more
        return self._ring

    def close(self) -> None:
        """Lets go of the ring."""
        if self._ring is not None:
            self._ring.close()
            self._ring = None


def _decoded(data: bytes) -> Frame | None:
    try:
        return wire.decode(data)
    except WireError:
        return None


def payload(frame: Frame, type_name: str) -> bytes:
    """The frame's payload as MessagePack, whatever its codec.

    Raises: NotFound or WireError when a coded payload cannot be read.
    """
    if frame.codec is Codec.NONE:
        return bytes(frame.payload)
    return registry.encode(registry.decode(registry.find(type_name), frame.payload, frame.codec))
