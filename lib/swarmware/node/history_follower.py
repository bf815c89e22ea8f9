"""Follows every value of a board: live values, and former values that arrive after an outage."""

from collections.abc import Callable
from typing import Final

from swarmware.errors import SwarmError
from swarmware.model import names, paths
from swarmware.model.frame import Frame
from swarmware.node.follower import RingFollower, mirror_of_platform
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file

REMEMBERED: Final = 4096
"""Size of the duplicate filter: if an acknowledgement is lost, the owner resends the value with the former
ones."""


class HistoryFollower:
    """Frames in the order of their arrival, each once, as their owner stamped them."""

    def __init__(self, node: Node, path: str, *, data_id: int | None = None) -> None:
        platform, local = names.split(path)
        self._live = RingFollower(
            ring_file(node.shm_dir, local, platform),
            name=f"board {path}",
            data_id=data_id,
            elsewhere=mirror_of_platform(node, path),
        )
        late = ring_file(node.shm_dir, paths.history(local), platform)
        self._late = RingFollower(late, name=f"history of {path}", data_id=data_id)
        self._returned: dict[tuple[int, int], None] = {}

    @property
    def refused(self) -> int:
        """Frames that were damaged, of another type or of another path."""
        return self._live.refused + self._late.refused

    @property
    def lost(self) -> int:
        """Frames that were overwritten here before `next()` could return them."""
        return self._live.lost + self._late.lost

    def next(self) -> Frame | None:
        """The next frame, or None before it arrives."""
        while (frame := self._live.next() or self._late.next()) is not None:
            key = (frame.sequence, frame.stamp_ns)
            if key not in self._returned:
                if len(self._returned) >= REMEMBERED:
                    del self._returned[next(iter(self._returned))]
                self._returned[key] = None
                return frame
        return None

    def refuse(self, error: SwarmError) -> None:
        """Count a frame that cannot be used; the first one is logged."""
        self._live.refuse(error)

    def listen(self, node: Node, on_change: Callable[[], None]) -> None:
        """Have `on_change` called at each change."""
        self._live.listen(node, on_change)
        self._late.listen(node, on_change)

    def close(self) -> None:
        """Stop listening, and close both rings."""
        self._live.close()
        self._late.close()
