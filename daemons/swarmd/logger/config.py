"""Settings of the logger (services/logger.toml)."""

from typing import Annotated, Literal

import msgspec


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Sampling, storage on disk, and forwarding to MongoDB."""

    period_s: Annotated[float, msgspec.Meta(ge=0.02, le=10)] = 0.1
    """Sampling period of all resources; a board with a higher rate is decimated to this period."""
    flush_s: Annotated[float, msgspec.Meta(ge=0.02, le=60)] = 0.5
    """Period of writing a batch to disk; a crash loses at most one batch."""
    sync: Literal["none", "batch", "segment"] = "segment"
    """Calls of fdatasync: never, after each batch, or after each segment."""
    segment_bytes: Annotated[int, msgspec.Meta(ge=1 << 16, le=1 << 30)] = 16 << 20
    """Size at which a new segment begins."""
    ring_bytes: Annotated[int, msgspec.Meta(ge=1 << 18)] = 512 << 20
    """Maximum size of the whole local ring; the oldest segment is deleted first."""
    min_free_bytes: Annotated[int, msgspec.Meta(ge=0)] = 256 << 20
    """Disk space that the ring leaves free."""
    mongodb_uri: str = ""
    """Address of the database, such as mongodb://10.0.0.1:27017, or "" for no forwarding."""
    mongodb_database: str = "swarm"
    """Name of the database."""
    queue_size: Annotated[int, msgspec.Meta(ge=100)] = 1_000_000
    """Number of slots of each circular queue in MongoDB."""
    queue_bytes: Annotated[int, msgspec.Meta(ge=1 << 20)] = 64 << 20
    """Maximum size of each circular queue in MongoDB; the oldest entries are deleted first."""
    forward_batch: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 1000
    """Maximum number of entries that are written to MongoDB at a time."""
    retry_s: Annotated[float, msgspec.Meta(gt=0, le=600)] = 2.0
    """Pause before the next attempt when MongoDB did not answer."""
    answer_s: Annotated[float, msgspec.Meta(ge=0.1, le=600)] = 5.0
    """Time-out of one batch; the first time-out reports a fault, the second one sends the batch again."""
