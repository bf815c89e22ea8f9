"""Rings of this node's own resources and of mirrors: looked at once, or watched."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from swarmware import frame as wire
from swarmware.errors import NotFound, SwarmError, WireError
from swarmware.frame import Codec, Frame
from swarmware.node import Node
from swarmware.resource import Kind as ResourceKind
from swarmware.resource import Resource
from swarmware.shm.layout import readers_folder, ring_file
from swarmware.shm.ring import RingReader
from swarmware.types import registry
from swarmware.types.tree import TreeItem

_ORDERED: Final = frozenset({ResourceKind.EVENT, ResourceKind.STREAM})


class Peek:
    """The newest frame of any resource, for a single look."""

    def __init__(self, shm_dir: Path) -> None:
        self._shm_dir = shm_dir
        self._rings: dict[tuple[str | None, str], RingReader] = {}

    def frame(self, path: str, platform: str | None = None) -> Frame | None:
        """The newest frame; None when there is none."""
        ring = self._ring(path, platform)
        if ring is None:
            return None
        try:
            data = ring.newest()
            return None if data is None else wire.decode(data)
        except WireError:
            return None

    def _ring(self, path: str, platform: str | None) -> RingReader | None:
        key = (platform, path)
        ring = self._rings.get(key)
        if ring is not None and ring.moved:
            del self._rings[key]
            ring.close()
            ring = None
        if ring is None:
            try:
                ring = self._rings[key] = RingReader(ring_file(self._shm_dir, path, platform))
            except SwarmError:
                return None
        return ring

    def close(self) -> None:
        """Lets go of all rings."""
        for ring in self._rings.values():
            ring.close()
        self._rings.clear()


class Tap:
    """Tells each new value of one own resource, when the doorbell has rung."""

    def __init__(
        self,
        node: Node,
        resource: Resource,
        tell: Callable[[TreeItem], None],
        overrun: Callable[[str, int], None],
    ) -> None:
        """`overrun`: told of items that were overwritten before they could be taken."""
        self.resource = resource
        self._overrun = overrun
        self._lost = 0
        self._node = node
        self._tell = tell
        self._path = ring_file(node.shm_dir, resource.path)
        self._ordered = resource.kind in _ORDERED
        self._ring: RingReader | None = None
        node.listen(readers_folder(self._path))
        node.watch(self)
        # of events, only those from now on; of a board, what there is
        self._open(after=None)
        self.poll()

    def _open(self, after: int | None) -> None:
        try:
            self._ring = RingReader(self._path, after=after)
        except SwarmError:
            self._ring = None

    def poll(self) -> None:
        """The doorbell has rung, perhaps for us."""
        if self._ring is None:
            if not self._path.exists():
                return
            self._open(after=0)  # all of it was written since we have been waiting
        while (ring := self._ring) is not None:
            self._take(ring)
            if not ring.moved:
                return
            try:
                self._ring = ring.reopen()
            except NotFound:
                self._ring = None
                ring.close()
            except SwarmError:
                return

    def _take(self, ring: RingReader) -> None:
        if self._ordered:
            while (data := ring.next()) is not None:
                if ring.lost != self._lost:
                    self._overrun(self.resource.path, ring.lost - self._lost)
                    self._lost = ring.lost
                self._give(data)
        elif ring.sequence != ring.seen and (data := ring.newest()) is not None:
            self._give(data)

    def _give(self, data: bytes) -> None:
        try:
            frame = wire.decode(data)
        except WireError:
            return
        if frame.data_id == self.resource.data_id:
            self._tell(
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
        """Looks no more."""
        self._node.unwatch(self)
        self._node.unlisten(readers_folder(self._path))
        if self._ring is not None:
            self._ring.close()
            self._ring = None


def plain_payload(frame: Frame, type_name: str) -> bytes:
    """The payload as MessagePack, whatever its codec.

    Raises: NotFound for an unknown type, WireError for a damaged payload.
    """
    if frame.codec is Codec.NONE:
        return bytes(frame.payload)
    return registry.encode(registry.decode(registry.find(type_name), frame.payload, frame.codec))
