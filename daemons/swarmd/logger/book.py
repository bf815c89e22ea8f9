"""The book of a node: batches of frames into the local ring, gaps as rows of their own."""

from collections import Counter
from pathlib import Path

import msgspec

from swarmd.logger.config import Config
from swarmd.logger.core import Track
from swarmware.errors import SwarmError
from swarmware.frame import Frame
from swarmware.record.ring import LogRing, Repairs
from swarmware.record.segment import Channel, Full
from swarmware.types import registry
from swarmware.types.log import LogGap

GAPS = "log/gaps"


class Batch:
    """What was taken from shared memory and is not yet on disk."""

    def __init__(self) -> None:
        self.frames: list[tuple[Track, Frame, int, str]] = []
        """Track, frame, the wall clock when it was taken, and of commands who sent it."""
        self.gaps: list[tuple[LogGap, int, int]] = []
        """Gap, stamp and wall clock."""

    def __bool__(self) -> bool:
        return bool(self.frames or self.gaps)


class Totals(msgspec.Struct):
    """Counters since the start."""

    frames: int = 0
    bytes: int = 0
    missing: int = 0


class Book:
    """Writes batches; blocks on the disk, so its calls belong into a thread."""

    def __init__(
        self, directory: Path, platform: str, config: Config, boot_id: int = 0, repairs: Repairs | None = None
    ) -> None:
        self.directory = directory
        self._platform = platform
        self._ring = LogRing(
            directory,
            segment_bytes=config.segment_bytes,
            ring_bytes=config.ring_bytes,
            min_free_bytes=config.min_free_bytes,
            sync=config.sync,
            boot_id=boot_id,
            repairs=repairs,
        )
        self._channels: dict[tuple[Track, str], Channel] = {}
        self.totals = Totals()
        self._lost: Counter[tuple[str, str]] = Counter()
        """Entries that found no room in memory while the disk took nothing, by queue and path."""

    @property
    def last_stamps(self) -> dict[str, int]:
        """Newest stamp of this boot by local path, also from before the start."""
        return self._ring.last_stamps

    @property
    def counters(self) -> dict[str, int]:
        """Last sequence of each queue."""
        return self._ring.counters

    @property
    def waiting(self) -> int:
        """Bytes in memory that the disk has not taken."""
        return self._ring.waiting

    def write(self, batch: Batch) -> None:
        """Writes the batch and ends it.

        Raises: OSError when the disk does not take it: it is kept and written with a later one; what finds
        no room in memory then is counted, and becomes gaps.
        """
        totals = self.totals
        for track, frame, utc_ns, sender in batch.frames:
            try:
                data = registry.messagepack(track.type, frame.payload, frame.codec)
            except SwarmError:
                data = bytes(frame.payload)
            channel = self._channel(track, sender)
            try:
                self._ring.append(channel, frame.stamp_ns, utc_ns, data)
            except Full:
                self._lost[channel.queue, channel.path] += 1
                continue
            totals.frames += 1
            totals.bytes += len(data)
        for gap, stamp_ns, utc_ns in batch.gaps:
            self._append_gap(gap, stamp_ns, utc_ns)
        self._ring.flush()
        if self._lost and batch.frames:
            _, frame, utc_ns, _ = batch.frames[-1]
            lost, self._lost = self._lost, Counter()
            for (queue, path), count in lost.items():
                self._append_gap(LogGap("disk", queue, path, count), frame.stamp_ns, utc_ns)
            self._ring.flush()

    def _append_gap(self, gap: LogGap, stamp_ns: int, utc_ns: int) -> None:
        channel = Channel(self._platform, GAPS, "event", "LogGap", f"{self._platform}:logger:out")
        try:
            self._ring.append(channel, stamp_ns, utc_ns, registry.encode(gap))
        except Full:
            self._lost[gap.queue, gap.path] += gap.count
            return
        self.totals.missing += gap.count

    def _channel(self, track: Track, sender: str = "") -> Channel:
        channel = self._channels.get((track, sender))
        if channel is None:
            direction = "in" if track.kind == "command" else "out"
            queue = f"{self._platform}:{track.module}:{direction}"
            channel = Channel(self._platform, track.path, str(track.kind), track.type, queue, sender)
            self._channels[track, sender] = channel
        return channel

    def queue(self, track: Track) -> str:
        """Name of the queue into which the track is written."""
        return self._channel(track).queue

    def size(self) -> tuple[int, int]:
        """Number of segments and their bytes."""
        return self._ring.size()

    def close(self) -> None:
        """Ends the last segment properly."""
        self._ring.close()
