"""Mirrors: rings of other platforms' resources, in which this process writes the frames of their owners."""

from collections.abc import Collection, Iterable
from typing import Final

from swarmware.errors import SwarmError, WireError
from swarmware.model import names, paths
from swarmware.model.frame import Frame, FrameKind, encode, restamp
from swarmware.node.follower import RingFollower
from swarmware.node.node import MIRROR_SLOTS, Node
from swarmware.node.publication import Publication
from swarmware.transport.shm.layout import RING_SUFFIX, ring_file, ring_path
from swarmware.transport.shm.reap import mirror_folders, reap_ring

SLOTS: Final = {FrameKind.BOARD: MIRROR_SLOTS, FrameKind.EVENT: 512, FrameKind.STREAM: 1024}
"""Slots of a mirror by kind of frame: a whole window of notifications may become readable at once, and the
ring must hold all of it until its readers wake."""
LARGE_BYTES: Final = 8 * 1024
LARGE_SLOTS: Final = 128
"""Slots for items above `LARGE_BYTES`: a window of notifications cannot contain more of them."""
EPOCHS: Final = 4
"""Number of recent starts of an owner whose items are distinguished: late items of a former start may follow
items of the new one."""

Position = tuple[int, int]
"""Sequence and stamp of an item."""


class ArrivalOrder:
    """Recognises items of an event or stream that were written before: a lost acknowledgement repeats them.

    Numbers and stamps grow within one epoch of the owner; a restarted owner may begin both again.
    """

    __slots__ = ("_newest", "_resumed")

    def __init__(self, resumed: Position | None = None) -> None:
        """`resumed`: newest item of a former writer of the mirror, to compare the first epoch with."""
        self._newest: dict[int, Position] = {}
        self._resumed = resumed

    def is_late(self, epoch: int, sequence: int, stamp_ns: int) -> bool:
        """Whether the item was written before, or a newer one of its epoch."""
        newest = self._newest.get(epoch, None if self._newest else self._resumed)
        return newest is not None and sequence <= newest[0] and stamp_ns <= newest[1]

    def on_written(self, epoch: int, sequence: int, stamp_ns: int) -> None:
        """Record that the item was written: it is the newest of its epoch."""
        # A former epoch stays for late items of the owner's former start; the oldest goes first.
        while epoch not in self._newest and len(self._newest) >= EPOCHS:
            del self._newest[next(iter(self._newest))]
        self._newest[epoch] = (sequence, stamp_ns)


class _Mirror:
    """One resource of another platform: its ring, and its newest frame, which is reused for the next one."""

    __slots__ = ("_buffer", "_form", "_order", "_publication", "kind")

    def __init__(self, kind: FrameKind, publication: Publication, order: ArrivalOrder | None) -> None:
        """`order`: order of events and streams, or None to write each frame."""
        self.kind = kind
        self._publication = publication
        self._order = order
        self._buffer = bytearray()
        self._form: tuple[int, int, int, int, bytes, int] | None = None
        """Header fields of the buffered frame; the buffer is reused for a next frame that differs only in
        sequence, times and payload."""

    def write(self, frame: Frame, epoch: int | None) -> bool:
        sequence, stamp_ns = frame.sequence, frame.stamp_ns
        if epoch is None:
            sequence = self._publication.sequence + 1
        elif self._order is not None and self._order.is_late(epoch, sequence, stamp_ns):
            return False
        payload = frame.payload
        form = (frame.data_id, frame.sender_hw, frame.codec, frame.flags, frame.extension, len(payload))
        # Most values of a resource differ in numbers only: restamping a buffer saves the encoding of a
        # frame.
        if form != self._form:
            self._buffer, self._form = bytearray(encode(frame)), form
        restamp(self._buffer, sequence, stamp_ns, echo_rx_us=frame.echo_rx_us)
        self._buffer[len(self._buffer) - len(payload) :] = payload
        self._publication.publish(self._buffer)
        if epoch is not None and self._order is not None:
            self._order.on_written(epoch, sequence, stamp_ns)
        return True

    def close(self, *, unlink: bool) -> None:
        self._publication.close(unlink=unlink)


class MirrorWriter:
    """Writes mirrors: every received value of a board, every item of an event or stream once, and former
    values of boards apart from their newest ones."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._mirrors: dict[tuple[str, str], _Mirror] = {}
        self.written = 0
        """Number of values written."""
        self.refused = 0
        """Number of values that could not be written: too large, an invalid path, or no ring."""

    def write(self, platform: str, path: str, frame: Frame, *, epoch: int | None = None) -> bool:
        """Publish a value here as its owner stamped it; returns False if this item was written before.

        `epoch`: start of the owner that numbered the frame, or None to number it by the ring.
        Raises: SwarmError when the value is too large, the path is invalid, shared memory is full, or another
        process writes this mirror.
        """
        return self._write(platform, path, frame, epoch)

    def write_late(self, platform: str, path: str, frame: Frame, *, epoch: int) -> None:
        """Publish a former value of a board, for the readers of its history: the newest one stays.

        Raises: as `write`.
        """
        self._write(platform, paths.history(path), frame, epoch, SLOTS[FrameKind.STREAM])

    def _write(self, platform: str, path: str, frame: Frame, epoch: int | None, slots: int = 0) -> bool:
        try:
            mirror = self._mirrors.get((platform, path))
            if mirror is None or mirror.kind is not frame.kind:
                mirror = self._open(platform, path, frame, slots)
            if not mirror.write(frame, epoch):
                return False
        except SwarmError:
            self.refused += 1
            raise
        self.written += 1
        return True

    def _open(self, platform: str, path: str, frame: Frame, slots: int) -> _Mirror:
        """`slots`: number of slots, or 0 for the default of the frame's kind."""
        key = (names.check_computer(platform), names.check_path(path))
        kind = frame.kind
        # the kind comes from another platform
        if kind not in SLOTS:
            raise WireError(
                f"/{platform}/{path}: kind {kind.name.lower()}; expected a board, event or stream"
            )
        encode(frame)  # an invalid frame fails before a ring is made for it
        if key in self._mirrors:
            self._mirrors.pop(key).close(unlink=True)  # the resource has another kind now
        slots, order = slots or SLOTS[kind], None
        if slots > LARGE_SLOTS and len(frame.payload) > LARGE_BYTES:
            slots = LARGE_SLOTS
        if kind is not FrameKind.BOARD:
            # before the ring is claimed: a ring with another number of slots is replaced by an empty one
            order = ArrivalOrder(self._newest(platform, path))
        publication = self._node.mirror_writer(platform, path, slots=slots)
        mirror = self._mirrors[key] = _Mirror(kind, publication, order)
        return mirror

    def _newest(self, platform: str, path: str) -> Position | None:
        """The newest item of a former writer."""
        # a restarted tree must not repeat items that its former process has written
        follower = RingFollower(ring_file(self._node.shm_dir, path, platform), name=f"/{platform}/{path}")
        frame = follower.peek()
        follower.close()
        return None if frame is None else (frame.sequence, frame.stamp_ns)

    def platforms(self) -> list[str]:
        """Platforms with mirrors, including mirrors of a former start."""
        return [folder.name for folder in mirror_folders(self._node.shm_dir)]

    def keep_only(self, kept: Iterable[tuple[str, str]]) -> None:
        """Remove the mirrors of this writer except these, by platform and path."""
        for key in self._mirrors.keys() - set(kept):
            self._mirrors.pop(key).close(unlink=True)

    def release(self, platform: str, path: str) -> None:
        """Leave a mirror to another process, with its newest value."""
        mirror = self._mirrors.pop((platform, path), None)
        if mirror is not None:
            mirror.close(unlink=False)

    def prune(self, platform: str, kept_paths: Collection[str]) -> None:
        """Remove the mirrors of a platform except for these paths, including mirrors of a former start.

        A mirror that another process writes stays.
        """
        paths_kept = {*kept_paths, *map(paths.history, kept_paths)}
        self.keep_only([key for key in self._mirrors if key[0] != platform or key[1] in paths_kept])
        folder = self._node.shm_dir / platform
        for ring in folder.glob(f"*{RING_SUFFIX}"):
            # Rings of a former start have no writer here, so only their files are left to remove.
            if ring_path(ring) not in paths_kept:
                reap_ring(ring)

    def close(self) -> None:
        """Stop writing; the newest values stay readable, and a restarted writer continues the rings."""
        for mirror in self._mirrors.values():
            mirror.close(unlink=False)
        self._mirrors.clear()
