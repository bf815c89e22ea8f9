"""Settings of the logger (services/logger.toml)."""

from typing import Annotated, Literal

import msgspec


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is recorded, where, and when it is synced to disk."""

    period_s: Annotated[float, msgspec.Meta(ge=0.02, le=10)] = 0.1
    """Sampling period of all resources; a board with a higher rate is decimated to it."""
    flush_s: Annotated[float, msgspec.Meta(ge=0.02, le=60)] = 0.5
    """Period of the flush: a crash loses at most one batch."""
    sync: Literal["none", "batch", "segment"] = "segment"
    """When fdatasync is called: never, after each batch, after each segment."""
    segment_bytes: Annotated[int, msgspec.Meta(ge=1 << 16, le=1 << 30)] = 16 << 20
    """Size at which a new segment begins."""
    ring_bytes: Annotated[int, msgspec.Meta(ge=1 << 18)] = 512 << 20
    """Size of the whole local ring; the oldest segment is deleted first."""
    min_free_bytes: Annotated[int, msgspec.Meta(ge=0)] = 256 << 20
    """Free disk space that the ring leaves."""
    mongodb_uri: str = ""
    """Address of the database, such as mongodb://10.0.0.1:27017; empty: no forwarding."""
    mongodb_database: str = "swarm"
    """Name of the database."""
    queue_size: Annotated[int, msgspec.Meta(ge=100)] = 1_000_000
    """Slots of each circular queue in MongoDB."""
    queue_bytes: Annotated[int, msgspec.Meta(ge=1 << 20)] = 64 << 20
    """Size of each of these queues; its oldest entries are deleted first."""
    forward_batch: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 1000
    """Entries written to MongoDB at a time."""
    retry_s: Annotated[float, msgspec.Meta(gt=0, le=600)] = 2.0
    """Pause before the next attempt after MongoDB did not answer."""
    answer_s: Annotated[float, msgspec.Meta(ge=0.1, le=600)] = 5.0
    """Time-out of one batch: after one time-out a fault is reported, after two the batch is sent again."""
