"""Reports of the broker on links, neighbours, routes and traffic, and its subscriptions and limits."""

from typing import Final

import msgspec

from swarmware.model import names
from swarmware.model.open_enum import OpenEnum
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.bounds import Count, Uint32
from swarmware.types.registry import register

UNACCEPTED: Final = "?"
"""Name in the counters of links for all senders that were not accepted."""


class LinkStatus(OpenEnum):
    """State of the two directions of a link."""

    RECEIVED = "heard"
    """Datagrams arrive here, and it is not known yet whether the neighbour receives this node."""
    UP = "up"
    HALF_OPEN = "half_open"
    """Datagrams arrive here, but the neighbour does not receive this node."""
    DOWN = "down"


class LinkTransport(OpenEnum):
    """Transport of a link's frames and beacons."""

    UDP = "udp"
    """Beacons, and frames as datagrams."""
    TCP = "tcp"
    """Frames by ZeroMQ."""
    SERIAL = "serial"
    """Beacons and frames on a serial line."""


class ConnectionStatus(OpenEnum):
    """Transport of frames to a neighbour: state of the TCP connections, or datagrams."""

    IDLE = "idle"
    """No connection: there was no frame to send."""
    CONNECTED = "tcp"
    CONNECTING = "tcp connecting"
    DENIED = "tcp denied"
    DATAGRAMS = "udp"
    """In datagrams that are acknowledged, because the link loses packets."""


class MediumUse(OpenEnum):
    """Directions in which a medium carries more than beacons and urgent frames."""

    NONE = "none"
    OUT = "out"
    """To the neighbour."""
    IN = "in"
    BOTH = "both"


@register
class MediumState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One of several media by which a neighbour is received, or was in the last minute."""

    medium: str
    """Name of the medium, the same at both ends."""
    state: LinkStatus
    address: str
    """Source address of its datagrams; of a serial line the name of the medium."""
    loss_in_ratio: float
    """Share of its last 32 datagrams that did not arrive here."""
    loss_out_ratio: float
    """Share of our last 32 datagrams that did not arrive at the neighbour, as it reports; 1 without a
    report."""
    silent_s: float
    rate_bit_s: float
    """Configured rate, or 0 if unknown."""
    cost: int
    """Cost of sending over this medium; 65535 if it is not usable."""
    use: MediumUse
    """Directions whose sender has chosen it for its frames."""


@register
class NeighbourState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A node that is received directly."""

    platform: str
    """Name of its platform; empty until its first hello."""
    unit: str
    hardware: int
    kind: PlatformKind
    """Kind of the platform; `other` for a kind that this node does not know."""
    state: LinkStatus
    address: str
    """Source address of its datagrams, `host:port`."""
    since_ns: int
    """Own clock when it entered this state."""
    silent_s: float
    """Time since the neighbour's newest datagram."""
    tick_hz: float
    loss_in_ratio: float
    """Share of its last 16 datagrams that did not arrive here."""
    loss_out_ratio: float
    """Share of our datagrams that did not arrive at the neighbour, as it reports."""
    rtt_ms: float | None
    """Round trip of datagrams without their holding time, or None before the first measurement."""
    cost: int
    """Link cost, expected transmissions in 1/256; 65535 if it is not usable."""
    tree_version: int
    mission: int
    boot_id: int
    transport: ConnectionStatus
    """Transport of frames to the neighbour: the worse state of its two connections, for commands and for
    data."""
    multicast: bool
    """False if the neighbour is reached by unicast datagrams, as a seed or because it sends unicast."""
    media: tuple[MediumState, ...] = ()
    """The media by which it is received, where this node has several."""

    @property
    def name(self) -> str:
        """Name of the node: its platform, and its unit where that is not `main`."""
        return str(names.Address(self.platform, self.unit or names.MAIN))


@register
class Neighbours(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All nodes received within the last minutes (board `net/neighbours`)."""

    neighbours: tuple[NeighbourState, ...] = ()


@register
class RouteState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Route to another node."""

    platform: str
    """Name of the platform, or its hardware id in hex while the name is unknown."""
    hardware: int
    via: str
    """Next hop, with its unit where that is not `main`; the node itself when it is a neighbour."""
    metric: int
    """256 for each hop without loss."""
    hops: int
    """Number of hops, estimated from the metric; 1 for a direct neighbour."""
    tree_version: int
    since_ns: int
    """Own clock when the next hop was selected."""
    unit: str = names.MAIN
    """Computer of the platform."""

    @property
    def name(self) -> str:
        """Name of the node: its platform, and its unit where that is not `main`."""
        return str(names.Address(self.platform, self.unit))


@register
class Routes(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All nodes with a route (board `net/routes`)."""

    routes: tuple[RouteState, ...] = ()


@register
class RosterMemberState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A member of the swarm, without its keys."""

    platform: str
    role: str
    serial: int
    """Admission number; changes when the platform rejoins."""
    revoked: bool = False


@register
class RosterState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The roster that is in force at a node (board `net/roster`, reply of `sys/broker/roster`)."""

    version: int = 0
    """Version of the roster, which rises with each change, or 0 if the node has no keys."""
    key_epoch: int = 0
    """Number of the group key."""
    swarm: str = ""
    root: str = ""
    """Fingerprint of the root that signed it."""
    members: tuple[RosterMemberState, ...] = ()
    revoked_self: bool = False
    """True if this node was revoked."""


@register
class SignedRoster(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A roster with the root's signature, or without text the request for the one in force
    (`sys/broker/roster`)."""

    text: bytes = b""
    """Content of `roster.json`."""


@register
class Denial(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A request that the role of its sender does not permit, a frame that was forwarded without a valid
    signature, a relayed value that its origin never sent, or a connection with a key that is not on the
    roster (events `net/denials`, `tree/denials`)."""

    platform: str
    """Authenticated platform of the sender; with verb `forward` the platform that forwarded the
    frame, with verb `relay` the sender of the beacon with the value, with verb `connect` a revoked platform,
    or the address of an unknown computer, with verb `beacon` the address of a member that forged a beacon of
    this node, with verb `key` the address of a node whose key is not on the roster."""
    role: str
    verb: str
    path: str
    count: int
    """Number since the last report of the same refusal."""
    reason: str
    caller: str = ""
    """User of the sender's computer, or "" for the platform itself."""
    via: tuple[str, ...] = ()
    """Platforms that forwarded it, the first one first; only the last one is certain."""


@register
class BoardPublication(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A board of this platform with remote subscribers."""

    path: str
    """Local path."""
    data_id: Uint32
    type: str
    min_interval_ms: Count = 0
    """Minimum interval of its values; 0 for every beacon."""
    is_ruled: bool = False
    """True if an operator's notification rule sets the interval, which precedes `channels.toml`."""


@register
class BoardSubscription(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A board of another platform with readers here."""

    platform: str
    path: str
    """Local path on that platform."""
    type: str
    data_id: Uint32
    unit: str = "main"
    """Computer of that platform whose broker sends it."""


@register
class StructureBroadcast(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Structure of a node's tree as its beacons carry it (stream `net/structures`): changes to a template."""

    node: str
    """Name of the node, with its unit where that is not `main`."""
    epoch: Count
    """Changes with each start of its tree service."""
    digest: int
    """Digest of its structure."""
    base: int
    """Digest of the template."""
    data: bytes
    """Changes in the form 2 of `StructureReply.data`."""


@register
class TreePlan(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Publications and subscriptions of the beacon: written by the tree, read by the broker (board
    `tree/plan`)."""

    tree_version: Uint32
    """Version of this platform's tree, which the beacon announces."""
    offers: tuple[BoardPublication, ...] = ()
    wants: tuple[BoardSubscription, ...] = ()
    mission: Uint32 = 0
    """Digest of the active mission, announced to neighbours, or 0 without a mission."""
    broadcast: StructureBroadcast | None = None
    """Own structure for the beacons, or None if it is too large for them."""
    needs: tuple[str, ...] = ()
    """Neighbours whose structure is needed."""
