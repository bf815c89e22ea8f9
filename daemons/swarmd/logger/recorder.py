"""The recorder of a node: writes batches of frames to the local log ring, and losses as gap records."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import msgspec

from swarmd.logger.config import Config
from swarmd.logger.core.sampling_plan import LoggedResource
from swarmware.errors import SwarmError
from swarmware.model.frame import Frame
from swarmware.model.resource import Kind
from swarmware.recorder.ring import LogRing, Repairs
from swarmware.recorder.segment import BufferFull, LogChannel
from swarmware.types import registry
from swarmware.types.log import GapCause, LogGap

GAPS = "log/gaps"


class Batch:
    """Frames and gaps that were read from shared memory and are not on disk yet."""

    def __init__(self) -> None:
        self.frames: list[tuple[LoggedResource, Frame, int, str]] = []
        """Logged resource, frame, UTC of the read in ns, and the sender if the frame is a command."""
        self.gaps: list[tuple[LogGap, int, int]] = []
        """Gap, stamp of the node's clock, UTC in ns."""
        self.descriptions: Mapping[tuple[str, str], str] = {}
        """Descriptions of the types that modules define, by path and type."""
        self.utc_minus_clock_ns: int | None = None
        """UTC minus node clock at the last read, by which readers of the log show stamps as UTC."""

    def __bool__(self) -> bool:
        return bool(self.frames or self.gaps)


class RecorderTotals(msgspec.Struct):
    """Entries and bytes written, and entries missing, since the start of the service."""

    frames: int = 0
    bytes: int = 0
    missing: int = 0


class Recorder:
    """Writes batches to the ring; every call may block on the disk, and belongs in a thread."""

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
        self._channels: dict[tuple[LoggedResource, str], LogChannel] = {}
        self._descriptions: Mapping[tuple[str, str], str] = {}
        self.totals = RecorderTotals()
        self._lost: Counter[tuple[str, str]] = Counter()
        """Number of entries dropped because the write buffer was full, by queue and path."""

    @property
    def last_stamps(self) -> dict[str, int]:
        """Newest stamp of this boot by local path, including entries of the previous run."""
        return self._ring.last_stamps

    @property
    def counters(self) -> dict[str, int]:
        """Newest sequence number of each queue."""
        return self._ring.counters

    @property
    def pending_bytes(self) -> int:
        """Number of bytes in the write buffer."""
        return self._ring.pending_bytes

    def write(self, batch: Batch) -> None:
        """Writes a batch and flushes it.

        Raises: OSError when the write fails. The batch stays in the write buffer and is written with the next
        batch; entries that do not fit into the buffer are counted and reported as gaps.
        """
        totals = self.totals
        if batch.utc_minus_clock_ns is not None:
            self._ring.set_clock(batch.utc_minus_clock_ns)
        if batch.frames and batch.descriptions is not self._descriptions:
            self._descriptions = batch.descriptions
            # each channel holds the description of its type
            self._channels.clear()
        for resource, frame, utc_ns, sender in batch.frames:
            try:
                data = registry.messagepack(resource.type, frame.payload, frame.codec)
            except SwarmError:
                # a type that this process does not know, or an invalid payload, is recorded unchanged
                data = bytes(frame.payload)
            channel = self._channel(resource, sender)
            try:
                self._ring.append(channel, frame.stamp_ns, utc_ns, data)
            except BufferFull:
                self._lost[channel.queue, channel.path] += 1
                continue
            totals.frames += 1
            totals.bytes += len(data)
        for gap, stamp_ns, utc_ns in batch.gaps:
            self._append_gap(gap, stamp_ns, utc_ns)
        self._ring.flush()
        if self._lost and batch.frames:
            # reported only after a flush succeeded, since the buffer is full until then
            _, frame, utc_ns, _ = batch.frames[-1]
            lost, self._lost = self._lost, Counter()
            for (queue, path), count in lost.items():
                self._append_gap(LogGap(GapCause.DISK, queue, path, count), frame.stamp_ns, utc_ns)
            self._ring.flush()

    def _append_gap(self, gap: LogGap, stamp_ns: int, utc_ns: int) -> None:
        channel = LogChannel(self._platform, GAPS, "event", "LogGap", f"{self._platform}:logger:out")
        try:
            self._ring.append(channel, stamp_ns, utc_ns, registry.encode(gap))
        except BufferFull:
            self._lost[gap.queue, gap.path] += gap.count
            return
        self.totals.missing += gap.count

    def _channel(self, resource: LoggedResource, sender: str = "") -> LogChannel:
        channel = self._channels.get((resource, sender))
        if channel is None:
            direction = "in" if resource.kind == Kind.COMMAND else "out"
            queue = f"{self._platform}:{resource.module}:{direction}"
            described = self._descriptions.get((resource.path, resource.type), "")
            kind = str(resource.kind)
            channel = LogChannel(self._platform, resource.path, kind, resource.type, queue, sender, described)
            self._channels[resource, sender] = channel
        return channel

    def queue(self, resource: LoggedResource) -> str:
        """Name of the log queue of a resource."""
        return self._channel(resource).queue

    def size(self) -> tuple[int, int]:
        """Number of segments of the ring, and their total size in bytes."""
        return self._ring.size()

    def close(self) -> None:
        """Writes the summary of the last segment and closes it."""
        self._ring.close()
