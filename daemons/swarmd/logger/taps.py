"""Taps, which read the frames of logged resources from their rings in shared memory."""

from pathlib import Path
from typing import Final

from swarmd.logger.core.sampling_plan import LoggedResource
from swarmware.model.frame import Frame
from swarmware.node.follower import RingFollower
from swarmware.transport.shm.layout import ring_file

LOOK_NS: Final = 500_000_000
"""Period of the search for a missing ring; a change of the applications starts a search at once."""


class LogTap:
    """Reads the frames of one resource that are not logged yet, starting with the oldest in its ring.

    `after_ns`: frames up to this stamp were logged by an earlier run of the service.
    """

    def __init__(self, shm_dir: Path, resource: LoggedResource, after_ns: int | None) -> None:
        self.resource = resource
        self._after_ns = after_ns
        self._follower = RingFollower(ring_file(shm_dir, resource.path), name=resource.path, from_oldest=True)
        self._look_ns = 0

    def is_idle(self, now_ns: int) -> bool:
        """True if the ring has no new frame, or is missing and not due for a search."""
        ring = self._follower.ring
        if ring is not None:
            return ring.read_to_end if self.resource.every_value else ring.unchanged
        if now_ns < self._look_ns:
            return True
        self._look_ns = now_ns + LOOK_NS
        return False

    def search_again(self) -> None:
        """Searches for a missing ring at the next call of `is_idle`."""
        self._look_ns = 0

    def newest(self) -> Frame | None:
        """The newest frame, or None if it was returned before."""
        frame = self._follower.newest()
        return None if frame is None or self._known(frame) else frame

    def all(self) -> tuple[list[Frame], int]:
        """Frames since the last call, in order, and the number of frames that were overwritten unread."""
        frames: list[Frame] = []
        while (frame := self._follower.next()) is not None:
            frames.append(frame)
        lost = self._follower.take_lost()
        fresh = [frame for frame in frames if not self._known(frame)]
        if len(fresh) < len(frames):
            lost = 0  # a frame that the previous run logged is preceded only by logged frames
        elif fresh:
            self._after_ns = None  # all frames are new from here on
        return fresh, lost

    def _known(self, frame: Frame) -> bool:
        return self._after_ns is not None and frame.stamp_ns <= self._after_ns

    def close(self) -> None:
        """Stops reading and closes the ring."""
        self._follower.close()
