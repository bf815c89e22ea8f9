"""Takes what is to be logged of one resource out of shared memory."""

from pathlib import Path
from typing import Final

from swarmd.logger.core import Track
from swarmware.frame import Frame
from swarmware.node.follower import RingFollower
from swarmware.shm.layout import ring_file

LOOK_NS: Final = 500_000_000
"""A ring that is not there is looked for this often, and when applications join or leave."""


class LogTap:
    """The frames of one resource that were not logged yet, from the oldest that is still in its ring.

    `after_ns`: frames up to this stamp are logged already, by this logger before it was restarted.
    """

    def __init__(self, shm_dir: Path, track: Track, after_ns: int | None) -> None:
        self.track = track
        self._after_ns = after_ns
        self._follower = RingFollower(ring_file(shm_dir, track.path), name=track.path, from_oldest=True)
        self._look_ns = 0

    def still(self, now_ns: int) -> bool:
        """Whether there cannot be anything new: the ring shows it, or was missing a moment ago."""
        ring = self._follower.ring
        if ring is not None:
            at = ring.position if self.track.every else ring.seen
            return ring.sequence == at and not ring.moved
        if now_ns < self._look_ns:
            return True
        self._look_ns = now_ns + LOOK_NS
        return False

    def look_again(self) -> None:
        """Look for a ring that was missing at the next call of `still`."""
        self._look_ns = 0

    def newest(self) -> Frame | None:
        """The newest frame, when it is another one than last time."""
        frame = self._follower.newest()
        return None if frame is None or self._known(frame) else frame

    def all(self) -> tuple[list[Frame], int]:
        """Every frame since last time, in order, and how many were overwritten before they were read."""
        frames: list[Frame] = []
        while (frame := self._follower.next()) is not None:
            frames.append(frame)
        lost = self._follower.take_lost()
        fresh = [frame for frame in frames if not self._known(frame)]
        if len(fresh) < len(frames):
            lost = 0  # what was before a frame that is logged already is logged too
        elif fresh:
            self._after_ns = None
        return fresh, lost

    def _known(self, frame: Frame) -> bool:
        return self._after_ns is not None and frame.stamp_ns <= self._after_ns

    def close(self) -> None:
        """Close the ring."""
        self._follower.close()
