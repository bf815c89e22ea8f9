"""The ring: frames from one writer to many readers, through a mapped file.

A board is read with `newest()`, a stream with `next()`. Nothing here waits: the doorbell wakes.
Each object belongs to one thread.
"""

import contextlib
import mmap
import os
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar
from zlib import crc32

from swarmware.errors import Conflict, OutOfRange, WireError
from swarmware.transport.shm import layout, ringfile
from swarmware.transport.shm.fence import Fence
from swarmware.transport.shm.layout import Geometry
from swarmware.transport.shm.lock import held_by_other
from swarmware.transport.shm.owner import Owner
from swarmware.transport.shm.shared_file import open_shared
from swarmware.transport.shm.view import View

Bytes = bytes | bytearray | memoryview
_Taken = TypeVar("_Taken")

TORN_TRIES = 1000
"""Maximum consecutive overwrites of a frame during its copy. Three never occurred with four
slots and a writer in a tight loop; a thousand mean that another process writes to the file."""
SKIP_TRIES = 64
"""Attempts of `next()` at a slot that is being written before it counts the frame as lost."""

_HEADER_BYTES, _SLOT_HEADER_BYTES = layout.HEADER_BYTES, layout.SLOT_HEADER_BYTES
_NEWEST, _MOVED = layout.W_NEWEST, layout.W_MOVED
_LENGTH_MASK, _SEED_MASK = layout.LENGTH_MASK, layout.SEED_MASK


class RingWriter:
    """The one writer of a ring.

    It continues an existing ring of the same slots whose owner is dead, without effect on readers.
    A ring of another layout is replaced by a new file, which readers detect by `moved`. Notify them in both
    cases.
    Raises: RingBusy when a living process writes it, RingFull without room, OutOfRange beyond the limits.
    """

    def __init__(
        self,
        path: Path,
        *,
        slots: int,
        slot_bytes: int,
        mode: int = 0o640,
        resume: ringfile.EpochPosition | None = None,
    ) -> None:
        self.path = path
        self.slots = slots
        self.slot_bytes = slot_bytes
        geometry = Geometry(slots, slot_bytes)
        self._map, self.taken_over = ringfile.claim(path, geometry, mode, resume)
        self._words = memoryview(self._map).cast("Q")
        self._lineage = self._words[layout.W_EPOCH]
        self._name = str(path)  # a check by a string takes a third of the time of a check by `Path`
        self._file = path.lstat()
        self._stride = geometry.stride
        self._checked = geometry.checked
        self._sequence = self._words[_NEWEST]
        self._fence = Fence()
        self._loan: memoryview | None = None
        self.nonce = self._words[layout.W_NONCE]
        self._static = self._map[: layout.STATIC_BYTES]
        """The words that never change while the file is at its path."""

    @property
    def sequence(self) -> int:
        """Sequence of the newest frame written, or 0 before the first."""
        return self._sequence

    def write(self, data: Bytes) -> int:
        """Publish a frame; returns its sequence.

        Raises: OutOfRange when it is longer than a slot, Conflict while a slot is on loan.
        """
        if type(data) is memoryview:
            # a view of other items would have another length than its bytes
            data = data.cast("B")
        length = len(data)
        if length > self.slot_bytes or self._loan is not None:
            self._refuse(length)
        sequence = self._sequence + 1
        words = self._words
        base = _HEADER_BYTES + sequence % self.slots * self._stride
        slot = base >> 3
        start = base + _SLOT_HEADER_BYTES
        words[slot] = sequence
        if self._checked:
            self._map[start : start + length] = data
            words[slot + 2] = crc32(data, sequence & _SEED_MASK) << 32 | length
            words[slot + 1] = sequence
        else:
            self._fence()  # without a checksum readers rely on the order of the stores
            self._map[start : start + length] = data
            words[slot + 2] = length
            self._fence()
            words[slot + 1] = sequence
        words[_NEWEST] = self._sequence = sequence
        return sequence

    def loan(self, length: int) -> memoryview:
        """The bytes of the next slot, to be filled in place and published by `publish`.

        Nothing is visible before. The view is invalid afterwards. Raises: as `write`.
        """
        if length > self.slot_bytes or length < 0 or self._loan is not None:
            self._refuse(length)
        sequence = self._sequence + 1
        base = _HEADER_BYTES + sequence % self.slots * self._stride
        self._words[base >> 3] = sequence
        self._fence()
        start = base + _SLOT_HEADER_BYTES
        with memoryview(self._map) as whole:
            self._loan = whole[start : start + length]
        return self._loan

    def publish(self, length: int | None = None) -> int:
        """Publish the slot on loan, or only its first bytes; returns the sequence.

        Raises: Conflict when nothing is on loan, OutOfRange when it is longer than the loan.
        """
        loan = self._loan
        if loan is None:
            raise Conflict(f"{self.path}: nothing is on loan, expected loan() before publish()")
        if length is None:
            length = len(loan)
        elif not 0 <= length <= len(loan):
            raise OutOfRange(f"{self.path}: {length} bytes published, expected 0 to {len(loan)}, as on loan")
        sequence = self._sequence + 1
        slot = (_HEADER_BYTES + sequence % self.slots * self._stride) >> 3
        words = self._words
        meta = length
        if self._checked:
            with loan[:length] as written:
                meta |= crc32(written, sequence & _SEED_MASK) << 32
        words[slot + 2] = meta
        self._fence()
        words[slot + 1] = sequence
        words[_NEWEST] = self._sequence = sequence
        self.abandon()
        return sequence

    def abandon(self) -> None:
        """Return the slot on loan without publishing it."""
        if self._loan is not None:
            self._loan.release()
            self._loan = None

    def _refuse(self, length: int) -> None:
        if self._loan is not None:
            raise Conflict(f"{self.path}: a slot is on loan, expected publish() or abandon() first")
        raise OutOfRange(f"{self.path}: a frame of {length} bytes, expected 0 to {self.slot_bytes}")

    def intact(self, *, at_path: bool = False) -> bool:
        """Whether the file at the path is still this one, complete and with a valid header.

        `at_path`: true if the folder has not changed since a check, so that only the size is read.
        """
        if self._map.closed:
            return True
        if at_path:
            size = self._map.size()  # of the file, without a walk to its path
        elif (found := self._found()) is not None:
            size = found.st_size
        else:
            return False
        # a truncated file: touching its lost pages would end the process
        if size != len(self._map):
            return False
        return self._map[: layout.STATIC_BYTES] == self._static and self._words[_NEWEST] == self._sequence

    def _cut(self) -> bool:
        """Whether the file was truncated: access to the map of such a file ends the process."""
        found = self._found()
        return found is not None and found.st_size != len(self._map)

    def _found(self) -> os.stat_result | None:
        """Status of the file at the path if it is still this one."""
        try:
            found = os.lstat(self._name)
        except OSError:  # removed, or its folder: it is not at its path any more
            return None
        return found if os.path.samestat(found, self._file) else None

    def discard(self) -> ringfile.EpochPosition:
        """Close a damaged file; returns the position from which a new writer continues."""
        self.abandon()
        if not self._cut():
            self._words[_MOVED] = (
                1  # the file is no longer at its path: readers that have mapped it must reopen the path
            )
        self._words.release()
        _close(self._map)
        return self._lineage, self._sequence

    def close(self, *, unlink: bool = False) -> None:
        """Stop writing. The newest frames stay readable unless the file is unlinked."""
        if self._map.closed:
            return
        self.abandon()
        # pid 0 shows an orderly end, so that the next writer need not check a process
        layout.write_owner(self._words, Owner(0, 0, 0))
        if unlink:
            self._unlink()
        self._words.release()
        _close(self._map)

    def _unlink(self) -> None:
        with contextlib.suppress(FileNotFoundError, WireError):
            fd = open_shared(self.path, os.O_RDWR)
            try:
                # the nonce shows whether it is our file, whose lock we have; `unlink_ring` checks the inode
                if os.pread(fd, 8, layout.W_NONCE * 8) == bytes(
                    self._words[layout.W_NONCE : layout.W_NONCE + 1]
                ):
                    ringfile.unlink_ring(fd, self.path)
            finally:
                os.close(fd)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class RingReader:
    """One reader of a ring; the file is mapped read-only.

    `after`: `next()` begins after this sequence and counts overwritten frames as lost; use 0 for a reader
    that waited for the ring. With None it begins with the first frame written from now on.
    Raises: NotFound, Denied, WireError when the file is not a ring.
    """

    def __init__(self, path: Path, *, after: int | None = None) -> None:
        self.path = path
        fd = ringfile.open_reading(path)
        try:
            self._map = ringfile.map_reading(fd, path)
            self._file = os.fstat(fd)
        finally:
            os.close(fd)
        self._words = memoryview(self._map).cast("Q")
        try:
            geometry = layout.read_header(self._words, len(self._map), path)
        except WireError:
            self.close()
            raise
        self.slots = geometry.slots
        self.slot_bytes = geometry.slot_bytes
        self._stride = geometry.stride
        self._checked = geometry.checked
        self._first = self._words[layout.W_FIRST]
        self._fence = Fence()
        self.nonce = self._words[layout.W_NONCE]
        self.epoch = self._words[layout.W_EPOCH]
        """Epoch, equal for replacements of the file: the sequences of one epoch are continuous."""
        self.seen = 0
        """Sequence of the frame that `newest()` or `view()` returned last."""
        self.lost = 0
        """Frames that were overwritten before `next()` could return them."""
        self.position = self._words[_NEWEST] if after is None else after
        """Sequence of the last frame that `next()` returned or skipped."""

    @property
    def sequence(self) -> int:
        """Sequence of the newest frame; `newest()` has a new frame when it differs from `seen`."""
        return self._words[_NEWEST]

    @property
    def unchanged(self) -> bool:
        """Whether `newest()` has returned the newest frame, and the path has no other file."""
        words = self._words
        return words[_NEWEST] == self.seen and not words[_MOVED]

    @property
    def read_to_end(self) -> bool:
        """Whether `next()` has returned the newest frame, and the path has no other file."""
        words = self._words
        return words[_NEWEST] == self.position and not words[_MOVED]

    @property
    def moved(self) -> bool:
        """Whether the file at the path was or is being replaced or removed: read to the end, then
        `reopen()`."""
        return self._words[_MOVED] != 0

    def reopen(self, path: Path | None = None) -> "RingReader":
        """A reader of the file at its path, or at another one, which continues at the position of this one;
        closes this one.

        Missed frames are counted in its `lost`. Raises: as the constructor; this reader then stays open.
        """
        fresh = RingReader(path or self.path)
        fresh.lost = self.lost
        fresh.position, fresh.seen = (self.position, self.seen) if fresh.same_epoch(self) else (0, 0)
        self.close()
        return fresh

    def same_epoch(self, former: "RingReader") -> bool:
        """Whether the sequences continue the numbering of a former file at the path."""
        return self.epoch == former.epoch

    @property
    def owner(self) -> Owner:
        """The present or last writer; pid 0 after an orderly end."""
        return layout.read_owner(self._words)

    def owner_alive(self) -> bool:
        """Whether the ring has a writer; its lock shows a writer of another PID namespace."""
        if self.owner.alive():
            return True
        try:
            fd = open_shared(self.path)
        except (OSError, WireError):  # removed, or not ours to open: no writer keeps it
            return False
        try:
            return os.path.samestat(os.fstat(fd), self._file) and held_by_other(fd)
        finally:
            os.close(fd)

    def newest(self) -> bytes | None:
        """A copy of the newest frame, or None before the first."""
        return self._latest(self._copy)

    def oldest(self) -> bytes | None:
        """A copy of the oldest frame that is still in the ring, or None if there is only one."""
        newest = self._words[_NEWEST]
        for sequence in range(max(newest - self.slots, self._first) + 1, newest):
            data = self._copy(sequence)
            if data is not None:  # else it is being overwritten
                return data
        return None

    def view(self) -> View | None:
        """The newest frame in place, without a copy, or None before the first."""
        return self._latest(self._look)

    def next(self) -> bytes | None:
        """A copy of the next frame in order, or None before it is written.

        Overwritten frames are skipped and counted in `lost`: every sequence is either returned once or
        counted.
        """
        return self._following(self._copy)

    def next_view(self) -> View | None:
        """The next frame in order in place, without a copy; otherwise as `next()`."""
        return self._following(self._look)

    def _latest(self, take: Callable[[int], _Taken | None]) -> _Taken | None:
        words = self._words
        for _ in range(TORN_TRIES):
            sequence = words[_NEWEST]
            if sequence == self._first:
                return None
            taken = take(sequence)
            if taken is not None:
                self.seen = sequence
                return taken
        raise WireError(f"{self.path}: frame {words[_NEWEST]} is never complete, expected one writer only")

    def _following(self, take: Callable[[int], _Taken | None]) -> _Taken | None:
        words = self._words
        tries = 0
        while True:
            newest = words[_NEWEST]
            wanted = self.position + 1
            if wanted > newest:
                return None
            oldest = newest - self.slots + 1
            if wanted < oldest or wanted <= self._first:
                # to the second oldest: the writer fills the oldest slot next
                self._skip_to(max(oldest, self._first) + 1)
                tries = 0
                continue
            taken = take(wanted)
            if taken is not None:
                self.position = wanted
                return taken
            tries += 1
            if wanted == oldest or tries > SKIP_TRIES:  # being overwritten now, or damaged from outside
                self._skip_to(wanted + 1)
                tries = 0

    def _skip_to(self, wanted: int) -> None:
        self.lost += wanted - 1 - self.position
        self.position = wanted - 1

    def _copy(self, sequence: int) -> bytes | None:
        """The bytes of one frame, or None if it is missing or was overwritten during the copy."""
        words = self._words
        base = _HEADER_BYTES + sequence % self.slots * self._stride
        slot = base >> 3
        if words[slot + 1] != sequence:
            return None
        meta = words[slot + 2]
        length = meta & _LENGTH_MASK
        if length > self.slot_bytes:
            return None
        start = base + _SLOT_HEADER_BYTES
        if self._checked:
            data = self._map[start : start + length]
            # The writer marks the slot before its first byte; the checksum also finds stores that became
            # visible in another order, which no fence prevents here.
            whole = words[slot] == sequence and crc32(data, sequence & _SEED_MASK) == meta >> 32
        else:
            self._fence()
            data = self._map[start : start + length]
            self._fence()
            whole = words[slot] == sequence
        return data if whole else None

    def _look(self, sequence: int) -> View | None:
        words = self._words
        base = _HEADER_BYTES + sequence % self.slots * self._stride
        slot = base >> 3
        if words[slot + 1] != sequence:
            return None
        meta = words[slot + 2]
        length = meta & _LENGTH_MASK
        if length > self.slot_bytes:
            return None
        self._fence()
        start = base + _SLOT_HEADER_BYTES
        with memoryview(self._map) as whole:
            data = whole[start : start + length]
        view = View(data, words[slot : slot + 2], sequence, meta >> 32 if self._checked else None)
        if view.still_valid():
            return view
        view.release()
        return None

    def close(self) -> None:
        """Unmap the file, or let the last view of it do so."""
        self._words.release()
        _close(self._map)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _close(ring: mmap.mmap) -> None:
    """Unmap the file; memory with a view is unmapped with the view."""
    with contextlib.suppress(BufferError):
        ring.close()
