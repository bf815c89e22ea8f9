"""The local ring of segments: bounded by bytes and by free disk, whole again after any crash."""

import shutil
from pathlib import Path
from typing import Final, Literal, NamedTuple

import msgspec

from swarmware.record.scan import MAGIC
from swarmware.record.segment import TAIL, Channel, SegmentReader, SegmentWriter, ended

Sync = Literal["none", "batch", "segment"]

DAMAGED: Final = ".damaged"
"""Ending of a segment in which nothing can be read; it ages in the ring like the others."""
_BOOT: Final = "#boot"
"""Stands among the stamps: those of another boot come from another clock."""
_BARE: Final = 4096
"""A file that short without a whole record was cut while it was begun: nothing is lost with it."""
_LOOK_BACK: Final = 3
"""Segments that are read at a start, at most, for how far the queues have come."""


class Hole(NamedTuple):
    """Entries that a start found damaged in what the last run had left."""

    queue: str
    first: int
    last: int


class Repairs(msgspec.Struct):
    """What was mended of what the last run had left; kept over starts that fail."""

    bytes: int = 0
    """Of half-written records."""
    set_aside: list[Path] = []
    """Segments in which nothing could be read."""
    holes: list[Hole] = []
    """Entries damaged in the segment that the last run had not ended."""


class LogRing:
    """Segments `<number>.mcap` in one directory; the oldest goes when the ring is full.

    One writer; any number of readers. Raises: OSError from the file system as it is.
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
        """Newest stamp of this boot by local path; empty in a new ring."""
        self._recover()
        self._old: SegmentWriter | None = None
        self._writer = self._open(self._last_number() + 1)

    def _recover(self) -> None:
        """Ends what the last run had not ended, and learns how far the queues have come.

        Of segments that were ended only the ends are read: a full ring starts as fast as an empty one.
        """
        last: SegmentReader | None = None
        for path in segments(self.directory):
            if not ended(path):
                last = self._repair(path)
        remaining = segments(self.directory)
        if last is not None and remaining and last.path == remaining[-1]:
            self._learn(last)
            remaining.pop()
            if last.sound:
                return
        for path in remaining[: -_LOOK_BACK - 1 : -1]:
            reader = SegmentReader(path)
            if not reader.final():
                _drain(reader)
            self._learn(reader)
            if reader.sound:
                return

    def _learn(self, reader: SegmentReader) -> None:
        """Takes what a segment knows; what a newer one said holds."""
        self._counters = reader.counters | self._counters
        if reader.stamps.pop(_BOOT, 0) == self._boot_id:
            self.last_stamps = reader.stamps | self.last_stamps

    def _repair(self, path: Path) -> SegmentReader | None:
        """Gives a segment a valid end; None when nothing can be read in it."""
        reader = SegmentReader(path)
        holes = _drain(reader)
        size = path.stat().st_size
        if reader.offset == len(MAGIC):
            if size <= _BARE:
                path.unlink()
                self.repairs.bytes += size
            else:
                self.repairs.set_aside.append(path.rename(path.with_suffix(DAMAGED)))
            return None
        with path.open("r+b") as file:
            # behind the last whole record only a half one can stand: everything else was read or passed over
            file.truncate(reader.offset)
            file.seek(0, 2)
            file.write(TAIL)
        # only now: without room for the end the next start repairs the segment once more
        self.repairs.holes += holes
        if not reader.ended:
            self.repairs.bytes += size - reader.offset
        return reader

    def _last_number(self) -> int:
        paths = _files(self.directory)
        return int(paths[-1].stem) if paths else 0

    def _open(self, number: int) -> SegmentWriter:
        return SegmentWriter(self.directory / f"{number:08d}.mcap", self._counters, self._stamps())

    def _stamps(self) -> dict[str, int]:
        return self.last_stamps | {_BOOT: self._boot_id}

    @property
    def counters(self) -> dict[str, int]:
        """Last sequence of each queue."""
        return dict(self._counters)

    @property
    def waiting(self) -> int:
        """Bytes that the disk has not taken yet."""
        return self._writer.waiting + (self._old.waiting if self._old is not None else 0)

    def append(self, channel: Channel, stamp_ns: int, utc_ns: int, payload: bytes) -> int:
        """Adds an entry to its queue; its sequence there.

        Raises: Full when the disk has taken nothing for too long; the entry has no sequence then.
        """
        sequence = self._counters.get(channel.queue, 0) + 1
        self._writer.append(channel, sequence, stamp_ns, utc_ns, payload)
        self._counters[channel.queue] = sequence
        self.last_stamps[channel.path] = stamp_ns
        return sequence

    def flush(self) -> None:
        """Ends a batch: it survives the process, and with sync `batch` also a loss of power.

        Raises: OSError when the disk does not take it; it is kept, and written by a later call.
        """
        self._end_old()
        if self._writer.flush() >= self._segment_bytes:
            self._rotate()
        elif self._sync == "batch":
            self._writer.sync()

    def _rotate(self) -> None:
        self._prune()
        fresh = self._open(int(self._writer.path.stem) + 1)
        self._writer.finish(self._counters, self._stamps())
        self._old, self._writer = self._writer, fresh
        self._end_old()

    def _end_old(self) -> None:
        """Ends the segment before; again with the next batch when there is no room for its end."""
        if self._old is None:
            return
        self._old.flush()
        if self._sync != "none":
            self._old.sync()
        old, self._old = self._old, None  # its bytes are safe, whatever the closing says
        old.close()

    def _prune(self) -> None:
        paths = _files(self.directory)
        total = sum(path.stat().st_size for path in paths)
        free = shutil.disk_usage(self.directory).free
        while paths and (total + self._segment_bytes > self._ring_bytes or free < self._min_free_bytes):
            oldest = paths.pop(0)
            if oldest == self._writer.path:
                return
            size = oldest.stat().st_size
            oldest.unlink()
            total -= size
            free += size

    def size(self) -> tuple[int, int]:
        """Number of segments, and their bytes on disk."""
        sizes = [path.stat().st_size for path in _files(self.directory)]
        return len(sizes), sum(sizes)

    def close(self) -> None:
        """Ends the last segment properly."""
        try:
            self._end_old()
        finally:
            self._writer.finish(self._counters, self._stamps())
            try:
                if self._sync != "none":
                    self._writer.flush()
                    self._writer.sync()
            finally:
                self._writer.close()


def segments(directory: Path) -> list[Path]:
    """The segments of a ring, oldest first."""
    return sorted(path for path in directory.glob("*.mcap") if path.stem.isdigit())


def set_aside(directory: Path) -> list[Path]:
    """Segments of a ring in which nothing could be read."""
    return sorted(path for path in directory.glob(f"*{DAMAGED}") if path.stem.isdigit())


def _files(directory: Path) -> list[Path]:
    return sorted([*segments(directory), *set_aside(directory)], key=lambda path: path.stem)


def _drain(reader: SegmentReader) -> list[Hole]:
    """Reads a segment to its end, for its counters and stamps; what is missing in its queues."""
    holes: list[Hole] = []
    for entry in reader.entries():
        expected = reader.counters.get(entry.queue, entry.sequence - 1) + 1
        if entry.sequence > expected:
            holes.append(Hole(entry.queue, expected, entry.sequence - 1))
        reader.counters[entry.queue] = entry.sequence
        reader.stamps[entry.path] = entry.stamp_ns
    return holes
