"""Data of the plots of an experiment: arrays and names."""

import msgspec

from swarmlab.measure.mission_timeline import BarrierPassage, MemberTimeline
from swarmlab.measure.tracks import TimeSeries, VehicleTrack
from swarmware.geometry.world import Obstacle
from swarmware.model.platform_kind import PlatformKind


class ObservedLink(msgspec.Struct, frozen=True):
    """A link as measured by one node."""

    node: str
    hears: str
    quality: float
    """Share of the other's datagrams that arrive, 0–1."""
    rtt_ms: float | None = None


class NodeFigures(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of one node."""

    platform: str
    kind: PlatformKind
    egress_kbps: float = 0.0
    ingress_kbps: float = 0.0
    receipt_ms: float | None = None
    cpu_percent: float | None = None
    rss_mb: float | None = None
    clock_error_us: float | None = None
    """95th percentile of the errors of its clock conversions."""
    formation_error_m: float | None = None
    """Mean error while the formation was formed."""
    offset_s: float = 0.0
    drift_ppm: float = 0.0
    outcome: str = ""
    """Final state of its mission, or the end of the node."""
    restarts: int = 0
    log: str = ""
    """Path of its processes' output, relative to the report; its log segments are in the same folder."""


class PlotData(msgspec.Struct, frozen=True, kw_only=True):
    """All data of the plots and the page; times are true seconds since the command."""

    title: str
    subtitle: str
    duration_s: float = 0.0
    nodes: tuple[NodeFigures, ...]
    """In the natural order of their names, as are all other members here."""
    tracks: dict[str, VehicleTrack]
    """Paths while the mission ran."""
    kinds: dict[str, PlatformKind]
    leader: str = ""
    course: tuple[tuple[float, float], ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    formation_errors: dict[str, TimeSeries] = {}
    formed: tuple[tuple[float, float], ...] = ()
    """Spans in which the formation was formed."""
    traffic: dict[str, TimeSeries] = {}
    """Egress of each node over time, kB/s."""
    neighbours: tuple[ObservedLink, ...] = ()
    unaccepted: int = 0
    """Datagrams of senders that were not accepted."""
    timelines: dict[str, MemberTimeline] = {}
    """Course of the mission on each member."""
    barriers: tuple[BarrierPassage, ...] = ()
