"""Mirrors of what other trees notify: handed over with the broker, which writes the boards of beacons."""

from collections.abc import Collection, Iterable

from swarmd.tree.core.action import WriteMirror
from swarmware.model.frame import FrameKind
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.node.node import Node
from swarmware.transport.shm.layout import RingBusy
from swarmware.types.net import BoardSubscription


class Mirrors:
    """Writes mirrors; of a board that the broker still writes, the newest value waits."""

    def __init__(self, node: Node) -> None:
        self._writer = MirrorWriter(node)
        self._waiting: dict[tuple[str, str], WriteMirror] = {}
        self._left: frozenset[tuple[str, str]] = frozenset()
        """Boards that come in beacons."""

    @property
    def written(self) -> int:
        """Number of values written."""
        return self._writer.written

    def platforms(self) -> list[str]:
        """Platforms with mirrors, including mirrors of a former start."""
        return self._writer.platforms()

    def write(self, action: WriteMirror) -> None:
        """Writes a value of another node. Raises: as `MirrorWriter.write`."""
        if action.late:
            self._writer.write_late(action.platform, action.item.path, action.frame, epoch=action.epoch)
            return
        key = (action.platform, action.item.path)
        try:
            self._writer.write(*key, action.frame, epoch=action.epoch)
        except RingBusy:
            # each item of an event or stream counts; of a board a newer value replaces this one
            if action.item.kind != FrameKind.BOARD:
                raise
            self._waiting[key] = action
        else:
            self._waiting.pop(key, None)
            if key in self._left:  # a notification that came late, before the first beacon
                self._writer.release(*key)

    def retry(self) -> None:
        """Writes what waits for the broker. Raises: as `MirrorWriter.write`."""
        for action in list(self._waiting.values()):
            self.write(action)

    def leave(self, wants: Iterable[BoardSubscription]) -> None:
        """Leaves the boards that come in beacons to the broker; their newest values stay readable."""
        self._left = frozenset((want.platform, want.path) for want in wants)
        for key in self._left:
            self._waiting.pop(key, None)
            self._writer.release(*key)

    def prune(self, platform: str, paths: Collection[str]) -> None:
        """Removes the mirrors of a platform except the mirrors of these paths."""
        for key in [key for key in self._waiting if key[0] == platform and key[1] not in paths]:
            del self._waiting[key]
        self._writer.prune(platform, paths)

    def close(self) -> None:
        """Stops writing; the newest values stay readable."""
        self._writer.close()
