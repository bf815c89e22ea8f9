"""Reader of the frames of a resource of any type, undecoded: for tools."""

import asyncio

from swarmware.model.frame import Frame
from swarmware.model.names import split
from swarmware.module.sequence_gaps import SequenceGaps
from swarmware.module.stream import FAIR
from swarmware.module.wakeup import Wakeup
from swarmware.node.follower import RingFollower, mirror_of_platform
from swarmware.node.history_follower import HistoryFollower
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file


class FrameReader:
    """`async for frame in reader`: the newest frames of a board, every frame of an event or stream, or the
    history of a board.

    It may be opened before there is a writer.
    """

    def __init__(self, node: Node, path: str, *, every: bool, history: bool = False) -> None:
        self.path = path
        self.every, self.history = every or history, history
        self._follower: RingFollower | HistoryFollower
        self._gaps: SequenceGaps | None = None
        """Gaps in the mirror of a stream, or None for any other resource."""
        if history:
            self._follower = HistoryFollower(node, path)
            self._read = self._follower.next
        else:
            platform, local = split(path)
            # only on the way from another platform do frames get lost between owner and ring
            if every and platform is not None:
                self._gaps = SequenceGaps()
            self._follower = RingFollower(
                ring_file(node.shm_dir, local, platform),
                name=f"frames {path}",
                elsewhere=mirror_of_platform(node, path),
            )
            self._read = self._follower.next if every else self._follower.newest
        self._wakeup = Wakeup()
        self._run = 0
        # last, as a bell may ring during the call
        self._follower.listen(node, self._wakeup.notify)

    @property
    def lost(self) -> int:
        """Frames of an event, a stream or a history that were overwritten before they were read, or lost on
        the way from another platform."""
        return self._follower.lost if self._gaps is None else self._gaps.lost

    def __aiter__(self) -> "FrameReader":
        return self

    async def __anext__(self) -> Frame:
        self._run += 1
        if self._run >= FAIR:
            self._run = 0
            await asyncio.sleep(0)
        while (frame := self._read()) is None:
            self._run = 0
            await self._wakeup.wait(None)
        if self._gaps is not None:
            self._gaps.on_item(frame.sequence, frame.stamp_ns)
        return frame

    def close(self) -> None:
        """Stop reading and close the ring."""
        self._follower.close()
