"""Mirrors of other platforms' resources that come by notification: rings that we write here."""

from collections.abc import Collection
from typing import Final

from swarmd.tree.core.mirror import is_newer
from swarmware.errors import WireError
from swarmware.model import frame as wire
from swarmware.model import names
from swarmware.model.frame import Codec, Frame, FrameKind
from swarmware.node.follower import RingFollower
from swarmware.node.node import Node
from swarmware.node.publication import Publication
from swarmware.transport.shm.layout import RING_SUFFIX, ring_file, ring_path
from swarmware.transport.shm.reap import mirror_folders, reap_ring
from swarmware.types.tree import TreeItem

MIRRORED: Final = frozenset({FrameKind.BOARD, FrameKind.EVENT, FrameKind.STREAM})
EVENT_SLOTS: Final = 512
STREAM_SLOTS: Final = 1024
"""A whole window of notifications may become readable at once: a reader woken by it finds all of it."""
LARGE_BYTES: Final = 8 * 1024
LARGE_SLOTS: Final = 128
"""Of larger items, a window holds no more than that."""


class _Mirror:
    def __init__(self, publication: Publication, sequence: int, stamp_ns: int) -> None:
        self.publication = publication
        self.sequence = sequence
        self.stamp_ns = stamp_ns


class Mirrors:
    """One ring per resource, in the folder of its platform."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._open: dict[tuple[str, str], _Mirror] = {}

    def write(self, platform: str, item: TreeItem) -> bool:
        """Publishes a value here as its owner stamped it; False: it was here already.

        Raises: SwarmError when there is no room, or somebody else writes this mirror.
        """
        try:
            kind, codec = FrameKind(item.kind), Codec(item.codec)
        except ValueError as error:
            raise WireError(f"notification of /{platform}/{item.path}: {error}") from error
        if kind not in MIRRORED:
            raise WireError(f"notification of /{platform}/{item.path}: kind {kind.name.lower()}")
        data = wire.encode(_frame(platform, item, kind, codec))  # before a ring is made for it
        mirror = self._mirror(platform, item.path, kind, len(item.data))
        if not is_newer(item, mirror.sequence, mirror.stamp_ns):
            return False
        mirror.publication.publish(data)
        mirror.sequence, mirror.stamp_ns = item.sequence, item.stamp_ns
        return True

    def _mirror(self, platform: str, path: str, kind: FrameKind, size: int) -> _Mirror:
        key = (platform, names.check_path(path))
        found = self._open.get(key)
        if found is None:
            # before the ring is claimed: a ring of other slots would be replaced by an empty one
            sequence, stamp_ns = self._newest(platform, path)
            if kind is FrameKind.BOARD:
                publication = self._node.mirror_writer(platform, path)
            else:
                slots = STREAM_SLOTS if kind is FrameKind.STREAM else EVENT_SLOTS
                if size > LARGE_BYTES:
                    slots = LARGE_SLOTS
                publication = self._node.mirror_writer(platform, path, slots=slots)
            found = self._open[key] = _Mirror(publication, sequence, stamp_ns)
        return found

    def _newest(self, platform: str, path: str) -> tuple[int, int]:
        """Sequence and stamp of what a former tree service wrote last."""
        follower = RingFollower(ring_file(self._node.shm_dir, path, platform), name=f"/{platform}/{path}")
        frame = follower.peek()
        follower.close()
        return (-1, -(1 << 63)) if frame is None else (frame.sequence, frame.stamp_ns)

    def platforms(self) -> list[str]:
        """Platforms of which there are mirrors, also from a former start."""
        return [folder.name for folder in mirror_folders(self._node.shm_dir)]

    def keep_only(self, platform: str, paths: Collection[str]) -> None:
        """Takes the mirrors of everything else of a platform away, also those of a former start.

        What another process writes, as the broker does, is its own to take away.
        """
        for key in [key for key in self._open if key[0] == platform and key[1] not in paths]:
            self._open.pop(key).publication.close()
        folder = self._node.shm_dir / platform
        for ring in folder.glob(f"*{RING_SUFFIX}"):
            if ring_path(ring) not in paths:
                reap_ring(ring)

    def forget(self, platform: str) -> None:
        """Takes the mirrors of a platform away."""
        self.keep_only(platform, ())

    def close(self) -> None:
        """Stops writing; what was written last stays readable."""
        for mirror in self._open.values():
            mirror.publication.close(unlink=False)
        self._open.clear()


def _frame(platform: str, item: TreeItem, kind: FrameKind, codec: Codec) -> Frame:
    return Frame(
        kind,
        item.data_id,
        names.hardware_id(platform),
        sequence=item.sequence,
        stamp_ns=item.stamp_ns,
        codec=codec,
        payload=item.data,
    )
