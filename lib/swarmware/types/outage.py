"""Outages of links to neighbours, and the summary of a node's links."""

import msgspec

from swarmware.model import names
from swarmware.model.open_enum import OpenEnum
from swarmware.types.registry import register


class OutagePhase(OpenEnum):
    """Progress of the recovery of a link."""

    LOST = "lost"
    """Nothing arrives in one direction or both."""
    RETURNING = "returning"
    """Datagrams of the neighbour arrive again, and it is not known yet whether it receives ours."""
    DRAINING = "draining"
    """The link is up, and frames wait for it."""
    OVER = "over"
    INTERRUPTED = "interrupted"
    """The broker of this node ended before the link was up again: its length is not known."""


class OutageCause(OpenEnum):
    """Observation that showed the loss of a link."""

    SILENT = "silent"
    """Nothing was received until the deadline."""
    HALF_OPEN = "half_open"
    """The neighbour does not receive this node."""
    RESTARTED = "restarted"
    """The broker of the neighbour began a new session."""


@register
class LinkOutage(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One outage of the link to a neighbour."""

    platform: str
    unit: str
    hardware: int
    began_utc_ns: int
    """Wall clock of this node when the link worked last."""
    cause: OutageCause
    phase: OutagePhase
    detected_after_s: float
    """Time from the last datagram, or the last acknowledged one, until the link counted as lost."""
    down_for_s: float | None = None
    """Time from the same instant until a datagram arrived again, or None while the link is lost."""
    recovered_in_s: float | None = None
    """Time from the first datagram until both directions were proven and routes used the link."""
    drained_in_s: float | None = None
    """Time from the recovery until no frame waited for the link any more, or None if the link was lost
    before, or a minute was not enough."""
    backlog_frames: int = 0
    """Maximum number of frames that waited for the link after it was up."""
    backlog_bytes: int = 0

    @property
    def name(self) -> str:
        """Name of the node: its platform, and its unit where that is not `main`."""
        return str(names.Address(self.platform, self.unit or names.MAIN))


@register
class OutageTable(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Outages of the links of a node, the newest first (board `net/outages`)."""

    outages: tuple[LinkOutage, ...] = ()


@register
class NodeLinks(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The links of a node in a few numbers, for health rules (board `net/links`)."""

    up: int
    """Neighbours whose link works in both directions."""
    half_open: int
    """Neighbours that are received, and do not receive this node."""
    best_loss_ratio: float | None
    """Loss of the worse direction of the best measured link, or None before a measurement."""
    worst_loss_ratio: float | None
    worst_rtt_ms: float | None
    outages: int
    """Links that are lost now, and were up before."""
    waiting_frames: int
    """Frames that wait for a link."""
    waiting_bytes: int
