"""The local ring of segments: bounded by bytes and by free disk, whole again after any crash."""

import os
import shutil
from pathlib import Path
from typing import Literal

from swarmware.record.segment import Channel, SegmentReader, SegmentWriter, repair

Sync = Literal["none", "batch", "segment"]


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
    ) -> None:
        self.directory = directory
        self._segment_bytes = segment_bytes
        self._ring_bytes = ring_bytes
        self._min_free_bytes = min_free_bytes
        self._sync = sync
        directory.mkdir(parents=True, exist_ok=True)
        self.repaired_bytes = 0
        """Bytes of half-written records that the last crash had left."""
        self._counters: dict[str, int] = {}
        self.last_stamps: dict[str, int] = {}
        """Newest stamp by local path in the last segment found; empty in a new ring."""
        self._recover()
        self._writer = self._open(self._last_number() + 1)

    def _recover(self) -> None:
        for path in segments(self.directory):
            self.repaired_bytes += repair(path)
        remaining = segments(self.directory)
        if remaining:
            reader = SegmentReader(remaining[-1])
            last: dict[str, int] = {}
            for entry in reader.entries():
                last[entry.queue] = entry.sequence
                self.last_stamps[entry.path] = entry.stamp_ns
            self._counters = reader.counters | last

    def _last_number(self) -> int:
        paths = segments(self.directory)
        return int(paths[-1].stem) if paths else 0

    def _open(self, number: int) -> SegmentWriter:
        return SegmentWriter(self.directory / f"{number:08d}.mcap", self._counters)

    @property
    def counters(self) -> dict[str, int]:
        """Last sequence of each queue."""
        return dict(self._counters)

    def append(self, channel: Channel, stamp_ns: int, utc_ns: int, payload: bytes) -> int:
        """Adds an entry to its queue; its sequence there."""
        sequence = self._counters.get(channel.queue, 0) + 1
        self._counters[channel.queue] = sequence
        self._writer.append(channel, sequence, stamp_ns, utc_ns, payload)
        return sequence

    def flush(self) -> None:
        """Ends a batch: it survives the process, and with sync `batch` also a loss of power."""
        size = self._writer.flush()
        if self._sync == "batch":
            os.fdatasync(self._writer.fileno())
        if size >= self._segment_bytes:
            self._rotate()

    def _rotate(self) -> None:
        number = int(self._writer.path.stem)
        self._finish()
        self._prune()
        self._writer = self._open(number + 1)

    def _finish(self) -> None:
        if self._sync != "none":
            self._writer.flush()
            os.fdatasync(self._writer.fileno())
        self._writer.close()

    def _prune(self) -> None:
        paths = segments(self.directory)
        total = sum(path.stat().st_size for path in paths)
        free = shutil.disk_usage(self.directory).free
        while paths and (total + self._segment_bytes > self._ring_bytes or free < self._min_free_bytes):
            oldest = paths.pop(0)
            size = oldest.stat().st_size
            oldest.unlink()
            total -= size
            free += size

    def size(self) -> tuple[int, int]:
        """Number of segments, and their bytes on disk."""
        sizes = [path.stat().st_size for path in segments(self.directory)]
        return len(sizes), sum(sizes)

    def close(self) -> None:
        """Ends the last segment properly."""
        self._finish()


def segments(directory: Path) -> list[Path]:
    """The segments of a ring, oldest first."""
    return sorted(path for path in directory.glob("*.mcap") if path.stem.isdigit())
