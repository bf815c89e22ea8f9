"""Follows the ring of one resource, whether or not it has a writer."""

import logging
from collections.abc import Callable
from pathlib import Path

from swarmware.errors import NotFound, SwarmError, WireError
from swarmware.model.frame import Frame, decode
from swarmware.model.names import has_unit_branch
from swarmware.node.node import Node
from swarmware.transport.shm.layout import readers_folder, ring_file
from swarmware.transport.shm.ring import RingReader  # noqa: TID251  # the follower of rings
from swarmware.transport.shm.ringfile import absent

log = logging.getLogger("swarm.follower")


class RingFollower:
    """Opens the ring when it appears, reopens it when it was replaced, and decodes its frames.

    `name`: name of the resource in the log. `data_id`: the only accepted data id, or None to accept any.
    `next()` begins with the first frame written from now on, with `from_oldest` with the oldest in the ring;
    in a ring that appears later, with its first. `elsewhere`: the ring to follow while `path` has no ring:
    the mirror of a resource that another computer of this platform provides.
    """

    def __init__(
        self,
        path: Path,
        *,
        name: str = "",
        data_id: int | None = None,
        from_oldest: bool = False,
        elsewhere: Path | None = None,
    ) -> None:
        self.ring: RingReader | None = None
        self.before = 0
        """Number of frames in former rings of other epochs, whose sequences are not continued."""
        self.refused = 0
        """Frames that were damaged, of another type or of another path."""
        self._path = path
        self._file = str(path)
        self._elsewhere = elsewhere
        self._other_file = None if elsewhere is None else str(elsewhere)
        self._name = name or self._file
        self._data_id = data_id
        self._lost = 0
        self._warned = ""
        self._node: Node | None = None
        self._on_change: Callable[[], None] | None = None
        self._reported = -1
        self._looked = -1
        """Number of changes of the folder of rings at the last search that found no ring."""
        self._open(0 if from_oldest else None)

    @property
    def position(self) -> int:
        """Number of frames written, whether returned or not, or -1 before the first writer."""
        ring = self.ring
        if ring is None or ring.moved:
            ring = self._open(0)
        return -1 if ring is None else self.before + ring.sequence

    @property
    def given(self) -> int:
        """Position of the frame that `newest()` returned last, or 0 before the first."""
        return 0 if self.ring is None else self.before + self.ring.seen

    @property
    def present(self) -> bool:
        """Whether the ring that was read last is still at the path."""
        return self.ring is not None and not self.ring.moved

    @property
    def lost(self) -> int:
        """Frames that were overwritten before `next()` could return them."""
        return 0 if self.ring is None else self.ring.lost

    def take_lost(self) -> int:
        """Frames lost since the last call."""
        before, self._lost = self._lost, self.lost
        return self._lost - before

    def newest(self) -> Frame | None:
        """The newest frame, or None if `newest()` has returned or refused it before."""
        ring = self.ring
        data = self._newest_elsewhere(ring) if ring is None or ring.moved else self._newest_of(ring)
        if data is None:
            return None
        try:
            frame = decode(data)
            if frame.data_id == self._data_id or self._data_id is None:
                return frame
            raise self._foreign(frame)
        except WireError as error:
            self.refuse(error)
            return None

    def peek(self) -> Frame | None:
        """The newest frame, even if `newest()` has returned it, or None without a ring."""
        ring = self.ring
        if ring is None or ring.moved:
            ring = self._open(0)
            if ring is None or ring.moved:
                return None
        # so that `newest` returns the frame again
        ring.seen = 0
        return self.newest()

    def oldest(self) -> Frame | None:
        """The oldest frame in the ring that was read last, or None if it has fewer than two."""
        data = None if self.ring is None else self.ring.oldest()
        if data is None:
            return None
        try:
            return decode(data)
        except WireError as error:
            self.refuse(error)
            return None

    def next(self) -> Frame | None:
        """The next frame in order, or None before it is written; overwritten frames are counted in `lost`."""
        while True:
            ring = self.ring or self._open(0)
            if ring is None:
                return None
            data = ring.next()
            if data is None:
                # a replaced ring is read to its end before the next one is opened
                if not ring.moved or self._open(0) is ring:
                    return None
                continue
            try:
                frame = decode(data)
                if frame.data_id == self._data_id or self._data_id is None:
                    return frame
                raise self._foreign(frame)
            except WireError as error:
                self.refuse(error)

    def refuse(self, error: SwarmError) -> None:
        """Count a frame that cannot be used; the first one is logged."""
        self.refused += 1
        if self.refused == 1:
            log.warning("%s: refused: %s", self._name, error)

    def listen(self, node: Node, on_change: Callable[[], None] | None) -> None:
        """Have `on_change` called at each change; read the ring after this call, not before.

        With None only the doorbell rings; the watcher of the doorbell reads the ring.
        """
        if self._node is None:
            self._node = node
            node.listen(readers_folder(self._path))
        if on_change is not None:
            self._on_change = on_change
            node.watch(self)

    def poll(self) -> None:
        """The doorbell has rung, perhaps for this ring."""
        ring = self.ring
        if ring is None:
            # the folder is the same as at the last search: the ring cannot have appeared
            if self._node is None or self._node.ring_changes == self._looked:
                return
            if self._found() is None:
                self._looked = self._node.ring_changes
                return
        elif ring.moved:
            self._reported = -1
        # one doorbell serves all rings of a process: most bells are for another one
        elif ring.sequence == self._reported:
            return
        else:
            self._reported = ring.sequence
        if self._on_change is not None:
            self._on_change()

    def close(self) -> None:
        """Stop listening, and close the ring."""
        if self._node is not None:
            self._node.unwatch(self)
            self._node.unlisten(readers_folder(self._path))
            self._node = None
        if self.ring is not None:
            self.ring.close()
            self.ring = None

    def _open(self, after: int | None) -> RingReader | None:
        """The ring at the path, or the former ring while the path has no new one."""
        former = self.ring
        path = self._found()
        if path is None:
            return former
        try:
            if former is None:
                self.ring = RingReader(path, after=after)
            else:
                written = former.sequence
                self.ring = former.reopen(path)
                if not self.ring.same_epoch(former):
                    # Positions must rise over a restart of the writer: the sequences of a new epoch begin
                    # at 0 again.
                    self.before += written
        except NotFound:
            return former
        except SwarmError as error:
            if str(error) != self._warned:  # once, not at every attempt
                self._warned = str(error)
                log.warning("%s", error)
            return former
        self._reported = -1  # the new ring may have the same sequence as the former
        return self.ring

    def _found(self) -> Path | None:
        """The path at which there is a ring now."""
        # the ring of this computer first: its application may have returned here
        if not absent(self._file):
            return self._path
        return None if self._other_file is None or absent(self._other_file) else self._elsewhere

    def _newest_of(self, ring: RingReader) -> bytes | None:
        """Bytes of the newest frame of one ring, if it was not returned or refused before."""
        sequence = ring.sequence
        if sequence == ring.seen:
            return None
        try:
            data = ring.newest()
        except WireError as error:
            self.refuse(error)
            data = None
        if data is None:
            ring.seen = sequence  # no readable frame: wait for the next one
        return data

    def _newest_elsewhere(self, former: RingReader | None) -> bytes | None:
        """Bytes of the newest frame when the ring does not exist yet, was withdrawn or replaced."""
        data = None if former is None else self._newest_of(former)  # it may hold the newest frame
        ring = self._open(0)
        return data if ring is None or ring is former else self._newest_of(ring) or data

    def _foreign(self, frame: Frame) -> WireError:
        return WireError(
            f"data id {frame.data_id:#010x}, of another type or path; expected {self._data_id or 0:#010x}"
        )


def mirror_of_platform(node: Node, path: str) -> Path | None:
    """Mirror of a local path that another computer of this platform may provide, or None for a local one."""
    if path.startswith("/") or has_unit_branch(path):
        return None
    return ring_file(node.shm_dir, path, node.platform)
