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
    """Counters of a process since its start: frames not delivered, or sent or received more than once."""

    malformed: int = 0
    """Received bytes that are not a frame, or an answer that cannot be decoded."""
    unanswerable: int = 0
    """Frames of a kind that needs no answer, which no application sends."""
    unclaimed_answers: int = 0
    """Answers whose receiving application has left."""
    expired: int = 0
    """Messages whose lifetime was over on arrival."""
    no_room: int = 0
    """Messages for a full inbox; their senders retransmit them."""
    oversized_answers: int = 0
    """Replies of handlers above 64 MiB; the caller got an error."""
    dropped: int = 0
    """The queue to another process of the node was full."""
    repeated: int = 0
    """Retransmissions, because no answer had arrived."""
    duplicates: int = 0
    """Duplicates: answered with the stored answer, not delivered."""
    denied: int = 0
    """Messages and requests of users of this computer whose role may not send them."""
    unclaimed_datagrams: int = 0
    """Datagrams of video for an address that no application serves."""


@register
class AppStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Report of an application, once a second: its heartbeat."""

    pid: int
    state: AppState
    beat: int
    """Heartbeat count; it does not change while the event loop hangs."""
    restarts: int = 0
    """Restarts inside the same process, on request or after a failure."""
    cpu_percent: float = 0.0
    """Processor time of the whole process, as a share of one core."""
    rss_mb: float = 0.0
    loop_lag_ms: float = 0.0
    """Maximum lateness of the event loop since the last report."""
    note: str = ""
    messages: MessageCounters | None = None
    """Message counters of the whole process, or None if all are zero."""
    failures: int = 0
    """Restarts after a failure among `restarts`."""


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
