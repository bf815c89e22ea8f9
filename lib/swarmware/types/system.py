"""Reports of a node about itself."""

import msgspec

from swarmware.types.open_enum import OpenEnum
from swarmware.types.registry import register


class AppState(OpenEnum):
    """State of an application."""

    STARTING = "starting"
    RUNNING = "running"
    RESTARTING = "restarting"
    STOPPING = "stopping"


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
    kind: str
    template: str
    version: str
    boot_id: int
    uptime_s: float
    services: tuple[str, ...]
    config_dir: str
    processes: str
