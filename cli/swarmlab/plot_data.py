"""What the plots show of an experiment: arrays and names, no file and no process."""

import msgspec

from swarmlab.measure import Floats, VehicleTrack
from swarmware.geometry.world import Obstacle


class TimeSeries(msgspec.Struct, frozen=True):
    """One quantity over time."""

    t_s: Floats
    value: Floats


class ObservedLink(msgspec.Struct, frozen=True):
    """A link as one node sees it."""

    node: str
    hears: str
    quality: float
    """Share of the other's datagrams that arrive, 0–1."""
    rtt_ms: float | None = None


class NodeFigures(msgspec.Struct, frozen=True, kw_only=True):
    """One node's share of the figures."""

    platform: str
    kind: str
    egress_kbps: float = 0.0
    ingress_kbps: float = 0.0
    receipt_ms: float | None = None
    cpu_percent: float | None = None
    rss_mb: float | None = None
    clock_error_us: float | None = None
    """p95 of its conversions of all others."""
    formation_error_m: float | None = None
    """Mean once formed."""
    offset_s: float = 0.0
    drift_ppm: float = 0.0
    outcome: str = ""
    """How its mission ended, or the node."""
    restarts: int = 0


class PlotData(msgspec.Struct, frozen=True, kw_only=True):
    """Everything the plots and the page are made of; times are true seconds since the command."""

    title: str
    subtitle: str
    nodes: tuple[NodeFigures, ...]
    tracks: dict[str, VehicleTrack]
    """Paths while the mission ran."""
    kinds: dict[str, str]
    leader: str = ""
    course: tuple[tuple[float, float], ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    formation_errors: dict[str, TimeSeries] = {}
    formed: tuple[tuple[float, float], ...] = ()
    """Spans in which the formation was formed."""
    traffic: dict[str, TimeSeries] = {}
    """Egress of each node over time, kB/s."""
    neighbours: tuple[ObservedLink, ...] = ()
