"""Application register: the applications of this platform and of all others (S1.51–55)."""

from typing import Annotated

import msgspec

from swarmware.types.registry import register


@register
class Application(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One running application instance."""

    name: str
    instance: int
    pid: int
    started_ns: int
    """Hardware clock of its start."""
    endpoint: str = ""
    """Address of its messages, valid on its own computer only."""
    provides: int = 0
    """Number of resources it provides."""
    serves: tuple[str, ...] = ()
    """Paths of the commands it answers, as far as they fit the table."""


@register
class ApplicationTable(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Register of one hardware unit, published by its master."""

    platform: str
    unit: str
    boot_id: int
    epoch: int
    """Fencing number: counts the masters of this unit; a table of an older one is void."""
    version: int
    """Counts the changes under one master; (boot_id, epoch, version) orders tables."""
    master: str
    """Application that holds the role: `register#1`."""
    stamp_ns: int
    applications: tuple[Application, ...] = ()
    omitted: int = 0
    """Applications for which the table had no room."""


@register
class KnownUnit(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Register of one hardware unit, as known here."""

    table: ApplicationTable
    hops: int
    """Number of hops: 0 for this unit, 1 for a neighbour, more for a unit known through others (S1.55)."""
    age_s: float
    """Since its master made the table, or since it was received where clocks cannot be compared."""


@register
class Register(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Registers of all units known here: the answer of `sys/register/apps`."""

    units: tuple[KnownUnit, ...] = ()


@register
class PartnerUnit(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One hardware unit of another platform, as the register of this node knows it."""

    table: ApplicationTable
    hops: int
    """Number of hops: 1 for a neighbour, more for other units."""
    made_ns: int
    """When its master made the table, or when it was received where clocks cannot be compared: hardware clock
    of this node."""
    unreachable_since_ns: int | None = None
    """Instant when it was last reachable, hardware clock of this node, or None while it is reachable."""


@register
class PartnerTable(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All units of other platforms (board `register/partners`); written when it changes only."""

    units: tuple[PartnerUnit, ...] = ()


@register
class PlatformRemoval(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/forget` and `sys/register/forget`: remove what is kept of a platform that has left
    the swarm, before its time is over."""

    platform: Annotated[str, msgspec.Meta(max_length=31)]


@register
class PlatformRemoved(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer to a `PlatformRemoval` of a node."""

    known: bool
    """Whether any data were removed."""
