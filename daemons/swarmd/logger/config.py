"""Settings of the logger (services/logger.toml)."""

from typing import Annotated, Literal

import msgspec


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is kept, where, and how safe it is."""

    period_s: Annotated[float, msgspec.Meta(ge=0.02, le=10)] = 0.1
    """How often the resources are looked at; boards faster than this are decimated to it at least."""
    flush_s: Annotated[float, msgspec.Meta(ge=0.02, le=60)] = 0.5
    """How often a batch ends: a crash loses at most one."""
    sync: Literal["none", "batch", "segment"] = "segment"
    """When the disk is told to write: never, after each batch, after each segment."""
    segment_bytes: Annotated[int, msgspec.Meta(ge=1 << 16, le=1 << 30)] = 16 << 20
    """Size at which a segment ends."""
    ring_bytes: Annotated[int, msgspec.Meta(ge=1 << 18)] = 512 << 20
    """Size of the whole local ring; the oldest segment goes first."""
    min_free_bytes: Annotated[int, msgspec.Meta(ge=0)] = 256 << 20
    """Space on the disk that the ring leaves to others."""
    mongodb_uri: str = ""
    """Where to forward to, such as mongodb://10.0.0.1:27017; empty: keep it local."""
    mongodb_database: str = "swarm"
    queue_size: Annotated[int, msgspec.Meta(ge=100)] = 1_000_000
    """Slots of each circular queue in MongoDB."""
    queue_bytes: Annotated[int, msgspec.Meta(ge=1 << 20)] = 64 << 20
    """Bytes of each of these queues; its oldest entries go first."""
    forward_batch: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 1000
    """Entries written to MongoDB at a time."""
    retry_s: Annotated[float, msgspec.Meta(gt=0, le=600)] = 2.0
    """Pause after MongoDB did not answer."""
    answer_s: Annotated[float, msgspec.Meta(ge=0.1, le=600)] = 5.0
    """Time that MongoDB may take for a batch: later is a fault, after the double it is tried again."""
