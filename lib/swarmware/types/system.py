"""Reports of a node about itself."""

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.registry import register


class AppState(OpenEnum):
    """State of an application."""

    STARTING = "starting"
    RUNNING = "running"
    RESTARTING = "restarting"
    STOPPING = "stopping"


@register
class MessageCounters(msgspec.Struct, array_like=True, gc=False):
    """Frames of a process that went no further, or were sent or received more than once, since its start."""

    malformed: int = 0
    """Not a frame, or an answer that cannot be decoded."""
    unanswerable: int = 0
    """Of a kind that asks for no answer, which no application sends."""
    unclaimed_answers: int = 0
    """Answers whose receiver has left."""
    expired: int = 0
    """Their lifetime was over on arrival."""
    no_room: int = 0
    """For a full inbox; their senders repeat them."""
    oversized_answers: int = 0
    """Replies of handlers that fit no frame; the caller got an error."""
    dropped: int = 0
    """The queue to another process of the node was full."""
    repeated: int = 0
    """Sent again, because no answer had come."""
    duplicates: int = 0
    """Received again: answered as the first time, not delivered."""


@register
class AppStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Report of an application, once a second: its heartbeat."""

    pid: int
    state: AppState
    beat: int
    """Heartbeat count; it does not change while the event loop hangs."""
    restarts: int = 0
    cpu_percent: float = 0.0
    """Of one core, of the whole process."""
    rss_mb: float = 0.0
    loop_lag_ms: float = 0.0
    """Maximum lateness of the event loop since the last report."""
    note: str = ""
    messages: MessageCounters | None = None
    """Of the whole process; None: nothing to count so far."""


@register
class SystemLoad(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Load of the computer."""

    cpu_percent: float
    memory_used_ratio: float
    disk_free_bytes: int
    load_1min: float
    temperature_degc: float | None = None


@register
class NodeInfo(msgspec.Struct, frozen=True):
    """Identity of a node."""

    platform: str
    unit: str
    kind: PlatformKind
    template: str
    version: str
    boot_id: int
    uptime_s: float
    services: tuple[str, ...]
    config_dir: str
    processes: str
