"""The local log ring: segments bounded by size and by free disk space, repaired after a crash."""

import os
from pathlib import Path
from typing import Final, Literal, NamedTuple

import msgspec

from swarmware.model.clock import utc_ns
from swarmware.recorder.growing_file import end_at, remove_unfinished
from swarmware.recorder.scan import MAGIC
from swarmware.recorder.segment import LogChannel, SegmentReader, SegmentWriter, ended

Sync = Literal["none", "batch", "segment"]

DAMAGED: Final = ".damaged"
"""Suffix of a segment without a readable record; the ring deletes it like any other segment."""
_BOOT: Final = "#boot"
"""Key of the boot id among the stamps: stamps of another boot are of another clock."""
_EMPTY_FILE_BYTES: Final = 4096
"""A file up to this size without a complete record was cut at its creation: no entry is lost with it."""
_SEGMENTS_READ: Final = 3
"""Maximum number of segments that a start reads to restore the sequence numbers."""
_SPARE: Final = 8
"""The room of a segment is larger than it by this part: a batch may reach beyond its size."""
_GRANULE_NS: Final = 20_000_000
"""Two changes of the folder within this time may have the same time stamp."""


class Hole(NamedTuple):
    """Entries of one queue that a start found missing in the segment of the last run."""

    queue: str
    first: int
    last: int


class Repairs(msgspec.Struct):
    """Repairs made at the start; kept over failed attempts to start."""

    bytes: int = 0
    """Size of the incomplete records that were cut off."""
    set_aside: list[Path] = []
    """Segments without a readable record."""
    holes: list[Hole] = []
    """Entries missing in the segment that the last run had not finished."""


class LogRing:
    """Segments `<number>.mcap` in one directory; the oldest is deleted when the ring is full.

    One writer; any number of readers. Raises: OSError of the file system.
    """

    def __init__(
        self,
        directory: Path,
        *,
        segment_bytes: int = 16 << 20,
        ring_bytes: int = 512 << 20,
        min_free_bytes: int = 256 << 20,
        sync: Sync = "segment",
        boot_id: int = 0,
        repairs: Repairs | None = None,
    ) -> None:
        self.directory = directory
        self._boot_id = boot_id
        self._segment_bytes = segment_bytes
        self._ring_bytes = ring_bytes
        self._min_free_bytes = min_free_bytes
        self._sync = sync
        directory.mkdir(parents=True, exist_ok=True)
        self.repairs = Repairs() if repairs is None else repairs
        self._counters: dict[str, int] = {}
        self.last_stamps: dict[str, int] = {}
        """Newest stamp of this boot, by local path; empty in a new ring."""
        self._recover()
        self._listed_ns = -1
        """Time of the folder when its finished segments were listed, or -1 to list them again."""
        self._finished = (0, 0)
        """Number and bytes of the segments that do not grow any more."""
        self._ended: SegmentWriter | None = None
        self._utc_minus_clock_ns: int | None = None
        self._writer = self._open(self._last_number() + 1)

    def _recover(self) -> None:
        """Repairs unfinished segments and restores the sequence number of every queue.

        Of finished segments only the end is read: a full ring starts as fast as an empty one.
        """
        remove_unfinished(self.directory)
        last: SegmentReader | None = None
        for path in segments(self.directory):
            if not ended(path):
                last = self._repair(path)
        remaining = segments(self.directory)
        if last is not None and remaining and last.path == remaining[-1]:
            self._take_counters(last)
            remaining.pop()
            if last.sound:
                return
        # Newest first: the first sound segment has the numbers of all queues.
        for path in remaining[: -_SEGMENTS_READ - 1 : -1]:
            reader = SegmentReader(path)
            if not reader.final():
                _drain(reader)
            self._take_counters(reader)
            if reader.sound:
                return

    def _take_counters(self, reader: SegmentReader) -> None:
        """Merges the counters of an older segment; values of a newer one take precedence."""
        self._counters = reader.counters | self._counters
        if reader.stamps.pop(_BOOT, 0) == self._boot_id:
            self.last_stamps = reader.stamps | self.last_stamps

    def _repair(self, path: Path) -> SegmentReader | None:
        """Write a valid end to an unfinished segment; returns None if it has no readable record."""
        reader = SegmentReader(path)
        holes = _drain(reader)
        size = path.stat().st_size
        if reader.offset == len(MAGIC):
            # Nothing was recorded; a larger file may hold data that a person can save, so it is only
            # renamed.
            if size <= _EMPTY_FILE_BYTES:
                path.unlink()
                self.repairs.bytes += size
            else:
                self.repairs.set_aside.append(path.rename(path.with_suffix(DAMAGED)))
            return None
        # only an incomplete record, or the room of the writer, can follow the last complete one
        end_at(path, reader.offset)
        # counted last: when the disk is full the next start repeats the repair
        self.repairs.holes += holes
        if not reader.ended and not reader.growing:
            self.repairs.bytes += size - reader.offset
        return reader

    def _last_number(self) -> int:
        paths = _files(self.directory)
        return int(paths[-1].stem) if paths else 0

    def _open(self, number: int) -> SegmentWriter:
        path = self.directory / f"{number:08d}.mcap"
        reserved_bytes = self._segment_bytes + self._segment_bytes // _SPARE
        return SegmentWriter(path, self._counters, self._stamps(), reserved_bytes=reserved_bytes)

    def set_clock(self, utc_minus_clock_ns: int) -> None:
        """Sets the offset with which the stamps of the next entries are written as UTC, for other readers."""
        self._utc_minus_clock_ns = utc_minus_clock_ns
        self._writer.set_clock(utc_minus_clock_ns)

    def _stamps(self) -> dict[str, int]:
        return self.last_stamps | {_BOOT: self._boot_id}

    @property
    def counters(self) -> dict[str, int]:
        """Last sequence number of each queue."""
        return dict(self._counters)

    @property
    def pending_bytes(self) -> int:
        """Bytes in the write buffers."""
        return self._writer.pending_bytes + (self._ended.pending_bytes if self._ended is not None else 0)

    def append(self, channel: LogChannel, stamp_ns: int, utc_ns: int, payload: bytes) -> int:
        """Appends an entry to its queue; its sequence number.

        Raises: BufferFull when the disk has not accepted data for too long; no sequence number is used then.
        """
        sequence = self._counters.get(channel.queue, 0) + 1
        self._writer.append(channel, sequence, stamp_ns, utc_ns, payload)
        # After `append` has taken it: a refused entry must not leave a gap in the numbers.
        self._counters[channel.queue] = sequence
        self.last_stamps[channel.path] = stamp_ns
        return sequence

    def flush(self) -> None:
        """Writes a batch: it survives a crash of the process, with sync `batch` also a power failure.

        Raises: OSError when the write fails; the batch stays buffered and is written by a later call.
        """
        self._close_ended()
        if self._writer.flush() >= self._segment_bytes:
            self._rotate()
        elif self._sync == "batch":
            self._writer.sync()

    def _rotate(self) -> None:
        self._prune()
        # The new file first: when the disk is full this fails, and the old segment stays in use.
        fresh = self._open(int(self._writer.path.stem) + 1)
        self._writer.finish(self._counters, self._stamps())
        self._ended, self._writer = self._writer, fresh
        if self._utc_minus_clock_ns is not None:
            fresh.set_clock(self._utc_minus_clock_ns)
        self._close_ended()

    def _close_ended(self) -> None:
        """Closes the previous segment; repeated with the next batch when the disk is full."""
        if self._ended is None:
            return
        self._ended.flush()
        if self._sync != "none":
            self._ended.sync()
        old, self._ended = self._ended, None  # its data is written, even if closing fails
        old.close()

    def _prune(self) -> None:
        paths = _files(self.directory)
        total = sum(path.stat().st_size for path in paths)
        disk = os.statvfs(self.directory)
        free = disk.f_bavail * disk.f_frsize
        while paths and (total + self._segment_bytes > self._ring_bytes or free < self._min_free_bytes):
            oldest = paths.pop(0)
            # The growing segment is never removed, even if it alone exceeds the limits.
            if oldest == self._writer.path:
                return
            size = oldest.stat().st_size
            oldest.unlink()
            total -= size
            free += size

    def size(self) -> tuple[int, int]:
        """Number of segments, and their size on disk in bytes; the folder is listed when it has changed."""
        changed_ns = os.stat(self.directory).st_mtime_ns  # noqa: PTH116  # after every batch: no Path object
        if self._ended is not None or changed_ns != self._listed_ns:
            sizes = [path.stat().st_size for path in _files(self.directory) if path != self._writer.path]
            self._finished = len(sizes), sum(sizes)
            settled = self._ended is None and utc_ns() - changed_ns > _GRANULE_NS
            self._listed_ns = changed_ns if settled else -1
        count, total = self._finished
        try:
            os.stat(self._writer.path)  # noqa: PTH116
        except FileNotFoundError:
            return count, total  # another process has removed it
        return count + 1, total + self._writer.written_bytes

    def close(self) -> None:
        """Writes the summary of the last segment and closes it."""
        try:
            self._close_ended()
        finally:
            self._writer.finish(self._counters, self._stamps())
            try:
                if self._sync != "none":
                    self._writer.flush()
                    self._writer.sync()
            finally:
                self._writer.close()


def segments(directory: Path) -> list[Path]:
    """Segments of a ring, oldest first."""
    return sorted(path for path in directory.glob("*.mcap") if path.stem.isdigit())


def set_aside(directory: Path) -> list[Path]:
    """Segments of a ring without a readable record."""
    return sorted(path for path in directory.glob(f"*{DAMAGED}") if path.stem.isdigit())


def _files(directory: Path) -> list[Path]:
    return sorted([*segments(directory), *set_aside(directory)], key=lambda path: path.stem)


def _drain(reader: SegmentReader) -> list[Hole]:
    """Reads a segment to its end and updates its counters and stamps; the missing entries of its queues."""
    holes: list[Hole] = []
    for entry in reader.entries():
        expected = reader.counters.get(entry.queue, entry.sequence - 1) + 1
        if entry.sequence > expected:
            holes.append(Hole(entry.queue, expected, entry.sequence - 1))
        reader.counters[entry.queue] = entry.sequence
        reader.stamps[entry.path] = entry.stamp_ns
    return holes
