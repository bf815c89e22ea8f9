"""What a node says about itself."""

import msgspec

from swarmware.types.registry import register


@register
class AppStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One application's own report, once a second: its beat."""

    pid: int
    state: str
    """starting | running | restarting | stopping."""
    beat: int
    """Counts up; a beat that stands still is a hung event loop."""
    restarts: int = 0
    cpu_percent: float = 0.0
    """Of one core, of the whole process."""
    rss_mb: float = 0.0
    loop_lag_ms: float = 0.0
    """Worst lateness of the event loop since the last report."""
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
    """Who a node is."""

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
