"""Rings of this node's resources and mirrors: looked at, watched, written."""

from collections.abc import Callable

from swarmware import frame as wire
from swarmware import names
from swarmware.errors import SwarmError, WireError
from swarmware.frame import Codec, Frame, Kind
from swarmware.node import Node, Publication
from swarmware.resource import Kind as ResourceKind
from swarmware.resource import Resource
from swarmware.shm.layout import readers_file, ring_file
from swarmware.shm.ring import RingReader
from swarmware.types import registry
from swarmware.types.tree import TreeItem

EVENT_SLOTS = 64
_ORDERED = frozenset({ResourceKind.EVENT, ResourceKind.STREAM})


class Peek:
    """The newest frame of any resource, for a single look."""

    def __init__(self, node: Node) -> None:
        self._node = node
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
            ring.close()
            ring = self._rings.pop(key, None) and None
        if ring is None:
            try:
                ring = RingReader(ring_file(self._node.shm_dir, path, platform), after=0)
            except SwarmError:
                return None
            self._rings[key] = ring
        return ring

    def close(self) -> None:
        """Lets go of all rings."""
        for ring in self._rings.values():
            ring.close()
        self._rings.clear()


class Tap:
    """Tells each new value of one own resource, when the doorbell has rung."""

    def __init__(self, node: Node, resource: Resource, tell: Callable[[TreeItem], None]) -> None:
        self._node = node
        self._resource = resource
        self._tell = tell
        self._path = ring_file(node.shm_dir, resource.path)
        self._ordered = resource.kind in _ORDERED
        self._ring: RingReader | None = None
        node.listen(readers_file(self._path))
        node.watch(self)
        self._open(after=None if self._ordered else 0)
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
            self._open(after=0)
        ring = self._ring
        if ring is None:
            return
        if self._ordered:
            while (data := ring.next()) is not None:
                self._give(data)
        elif ring.sequence != ring.seen and (data := ring.newest()) is not None:
            self._give(data)
        if ring.moved:
            try:
                self._ring = ring.reopen()
            except SwarmError:
                return

    def _give(self, data: bytes) -> None:
        try:
            frame = wire.decode(data)
        except WireError:
            return
        if frame.data_id == self._resource.data_id:
            self._tell(
                TreeItem(
                    self._resource.path,
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
        self._node.unlisten(readers_file(self._path))
        if self._ring is not None:
            self._ring.close()
            self._ring = None


class Mirrors:
    """Mirrors of other platforms' resources that come by notification."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._open: dict[tuple[str, str], Publication] = {}

    def write(self, platform: str, item: TreeItem) -> None:
        """Publishes a value here as its owner stamped it.

        Raises: SwarmError when there is no room, or the broker writes this mirror.
        """
        frame = Frame(
            Kind(item.kind),
            item.data_id,
            names.hardware_id(platform),
            names.ANY,
            sequence=item.sequence,
            stamp_ns=item.stamp_ns,
            codec=Codec(item.codec),
            payload=item.data,
        )
        self._publication(platform, item).publish(wire.encode(frame))

    def _publication(self, platform: str, item: TreeItem) -> Publication:
        key = (platform, item.path)
        found = self._open.get(key)
        if found is None:
            board = item.kind == Kind.BOARD
            more = {} if board else {"slots": EVENT_SLOTS}
            found = self._open[key] = self._node.mirror_writer(platform, item.path, **more)
        return found

    def forget(self, platform: str) -> None:
        """Takes the mirrors of a platform away."""
        for key in [key for key in self._open if key[0] == platform]:
            self._open.pop(key).close()

    def close(self) -> None:
        """Stops writing; what was written last stays readable."""
        for publication in self._open.values():
            publication.close(unlink=False)
        self._open.clear()


def plain_payload(frame: Frame, type_name: str) -> bytes:
    """The payload as MessagePack, whatever its codec.

    Raises: NotFound for an unknown type, WireError for a damaged payload.
    """
    if frame.codec is Codec.NONE:
        return bytes(frame.payload)
    return registry.encode(registry.decode(registry.find(type_name), frame.payload, frame.codec))
