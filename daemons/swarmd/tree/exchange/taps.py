"""Rings of this node's own resources and of mirrors: read once, or watched."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from swarmware.model.frame import Frame
from swarmware.model.resource import Kind, Resource
from swarmware.node.follower import RingFollower
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file
from swarmware.types.tree_exchange import TreeItem

_ORDERED: Final = frozenset({Kind.EVENT, Kind.STREAM})


class Peek:
    """The newest frame of any resource."""

    def __init__(self, shm_dir: Path) -> None:
        self._shm_dir = shm_dir
        self._followers: dict[tuple[str | None, str], RingFollower] = {}

    def frame(self, path: str, platform: str | None = None) -> Frame | None:
        """The newest frame, or None before the first."""
        key = (platform, path)
        follower = self._followers.pop(key, None)
        if follower is None:
            follower = RingFollower(ring_file(self._shm_dir, path, platform), name=path)
        frame = follower.peek()
        # without a ring there is nothing to keep open; the next question searches again
        if follower.present:
            self._followers[key] = follower
        else:
            follower.close()
        return frame

    def older(self, path: str, platform: str | None = None) -> Frame | None:
        """The oldest frame in the ring whose newest frame `frame` has returned."""
        follower = self._followers.get((platform, path))
        return None if follower is None else follower.oldest()

    def close(self) -> None:
        """Stop reading and close all rings."""
        for follower in self._followers.values():
            follower.close()
        self._followers.clear()


class Tap:
    """Passes each new value of one own resource to a callback; of events, only those from now on."""

    def __init__(
        self,
        node: Node,
        resource: Resource,
        on_value: Callable[[TreeItem], None],
        on_overrun: Callable[[str, int], None],
    ) -> None:
        """`on_overrun`: called with the number of items that were overwritten before they were read."""
        self.resource = resource
        self._on_value = on_value
        self._on_overrun = on_overrun
        self._follower = RingFollower(
            ring_file(node.shm_dir, resource.path), name=resource.path, data_id=resource.data_id
        )
        self._read = self._follower.next if resource.kind in _ORDERED else self._follower.newest
        # listening begins before the first reading, so that no value falls between the two
        self._follower.listen(node, self._take)
        self._take()

    def _take(self) -> None:
        while (frame := self._read()) is not None:
            # the loss before the value that follows it, as in the order of the ring
            if lost := self._follower.take_lost():
                self._on_overrun(self.resource.path, lost)
            self._on_value(
                TreeItem(
                    self.resource.path,
                    frame.data_id,
                    int(frame.kind),
                    frame.sequence,
                    frame.stamp_ns,
                    bytes(frame.payload),
                    int(frame.codec),
                )
            )

    def close(self) -> None:
        """Stop reading and close the ring."""
        self._follower.close()
