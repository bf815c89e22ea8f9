"""Statistics of the logger, and its records of missing entries."""

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.registry import register


class GapCause(OpenEnum):
    """Why entries are missing."""

    RING = "ring"
    """Values that were overwritten in shared memory before they were read."""
    DISK = "disk"
    """The disk was full."""
    DAMAGED = "damaged"
    """Values that could not be read from the disk."""
    OVERWRITTEN = "ring overwritten"
    """The local ring overwrote them before they were forwarded."""


@register
class LogGap(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Entries that are missing: a gap is a row of the log, never silence (event `log/gaps`)."""

    where: GapCause
    queue: str
    """Queue that misses them."""
    path: str
    """Resource, when it was one."""
    count: int
    first: int = 0
    """First missing sequence, when known."""
    last: int = 0
    """Last missing sequence, when known."""


@register
class LogStatsRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request for the statistics of the logger (`sys/log/stats`)."""

    flush: bool = False
    """Flush the write buffer before the reply."""


@register
class LogStats(msgspec.Struct, frozen=True):
    """Logger statistics (board `log/stats`)."""

    frames: int
    """Entries written to the local ring since the logger started."""
    bytes: int
    gaps: int
    """Entries missing, in all gap records since the logger started."""
    resources: int
    """Resources being logged."""
    segments: int
    ring_bytes: int
    """Size of the local ring on disk."""
    log_dir: str
    forwarded: int = 0
    """Entries acknowledged by MongoDB."""
    backlog: int = 0
    """Entries in the ring that MongoDB has not acknowledged."""
    mongodb: str = "off"
    """off, connected or away, then the reason: a text for operators."""
    complete_utc_ns: int = 0
    """Logger's wall clock: all earlier entries are in the local ring."""
