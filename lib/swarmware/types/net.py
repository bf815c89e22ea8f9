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
    """Datagrams arrive here; whether the neighbour receives this node is not known yet."""
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
class LinkTraffic(msgspec.Struct, array_like=True, gc=False):
    """Bytes of one link since the start: udp with IP headers, tcp the frames alone; `Traffic.tcp_sent_bytes`
    has the bytes of connections as the kernel counts them."""

    platform: str
    """Neighbour; `*` for multicast; `?` for the datagrams of senders that were not accepted: the first ones
    of every session, and refused ones."""
    transport: LinkTransport
    sent_frames: int = 0
    sent_bytes: int = 0
    received_frames: int = 0
    received_bytes: int = 0
    lost: int = 0
    """Datagrams that did not arrive."""
    late: int = 0
    """Datagrams overtaken by a later one."""
    duplicates: int = 0
    dropped: int = 0
    """Frames that were dropped because the queue was full or the frame too old."""
    repeated_bytes: int = 0
    """Bytes of frames that were sent again in datagrams, because they or their acknowledgements were lost."""
    offered_frames: int = 0
    """Frames that this node gave to the link; frames that moved to the other transport count for both."""
    delivered_frames: int = 0
    """Frames that the neighbour acknowledged; udp only, as connections do not show it."""
    waiting_frames: int = 0
    """Frames that wait for the link now, or are not acknowledged yet."""
    waiting_bytes: int = 0
    capacity_bytes_s: float | None = None
    """Throughput to the neighbour while the link was the limit, with headers, udp only; None if it never
    was, so that its capacity is unknown."""
    capacity_ns: int = 0
    """Own clock at the last measurement of the capacity."""


@register
class ChannelTraffic(msgspec.Struct, array_like=True, gc=False):
    """Frames and payload bytes of one channel since the start."""

    channel: str
    """Resource path, or kind of a frame whose path is unknown here."""
    offered_frames: int = 0
    """Values that were offered for sending."""
    offered_bytes: int = 0
    sent_frames: int = 0
    sent_bytes: int = 0
    received_frames: int = 0
    received_bytes: int = 0
    dropped: int = 0
    """Frames that were dropped: full queue, too old, denied."""
    late: int = 0
    """Values older than the cached one."""
    duplicates: int = 0
    max_hz: float | None = None
    """Rate limit in force."""
    held_back: int = 0
    """Values that the limit delayed until a newer one replaced them."""
    repeated_frames: int = 0
    """Frames that their sender sent again, because no answer came; counted as sent, too."""
    repeated_bytes: int = 0
    delivered_frames: int = 0
    """Messages and requests whose receiver answered; boards have no answer."""


@register
class Refused(msgspec.Struct, array_like=True, gc=False):
    """Counters of refused input from outside since the start."""

    forged: int = 0
    """Datagrams without a valid seal of this swarm, which do not name another swarm."""
    replayed: int = 0
    """Datagrams received before, and forwarded frames that were made too long ago."""
    old_session: int = 0
    """Datagrams of a session before the accepted one."""
    unknown_session: int = 0
    """Datagrams of a session that is not known yet, which is normal at the start."""
    other_epoch: int = 0
    malformed: int = 0
    spoofed: int = 0
    """Frames whose sender is not the member that sent or signed them."""
    denied_connections: int = 0
    """Incoming TCP connections that ended before they proved a key of the roster."""
    looped: int = 0
    """Frames that returned in a loop."""
    no_route: int = 0
    hop_limit: int = 0
    unheard: int = 0
    """Datagrams of platforms that `hear_only` excludes; not counted as received."""
    expired: int = 0
    """Frames of others whose lifetime was over here, which are neither forwarded nor delivered."""
    no_room: int = 0
    """Datagrams of senders beyond the limit of the neighbour table."""
    failed: int = 0
    """Datagrams on which this broker failed by a defect; the log has the place."""
    denied: int = 0
    """Messages and requests whose sender's role may not send them."""
    unproven: int = 0
    """Datagrams whose session was not confirmed by an answer, or after a restart by a proof, yet, or whose
    sender has signed none for too long."""
    flooded: int = 0
    """Datagrams dropped before their seal was checked: of unknown senders, or from addresses with too many
    invalid ones; not counted as received."""
    unsigned: int = 0
    """Frames that another member forwarded without a signature of their sender, and beacons without one where
    all are signed: in the whole swarm, or of a node in whose name another member seals some."""
    revoked: int = 0
    """Datagrams, frames and connections of platforms that were revoked; not counted as received."""
    rosters: int = 0
    """Rosters that the swarm's root did not sign, that are damaged, or older than the one in force."""
    unknown_keys: int = 0
    """Connections with a key that is not on the roster: of another swarm, or of no member."""
    undated: int = 0
    """Messages and requests with a lifetime, of a neighbour whose clock is not known here yet; it repeats
    them."""
    impersonated: int = 0
    """Beacons that a member has sealed in the name of another one: of this node, or of one in range."""
    damaged: int = 0
    """Frames of serial lines that were damaged: noise, or another rate; the log has the reasons."""
    scrapes: int = 0
    """Requests for the metrics page that were malformed, too long, too many, or without the token."""
    other_swarm: int = 0
    """Datagrams of another swarm on the same network, as their sessions state."""
    unsigned_values: int = 0
    """Relayed values of boards without a valid signature of their origin, where every beacon is signed."""


CERTAINLY_HOSTILE: Final = (
    "forged",
    "spoofed",
    "unsigned",
    "revoked",
    "unknown_keys",
    "impersonated",
    "unsigned_values",
)
"""Counters of `Refused` that input of a valid member never increments."""
HOSTILE: Final = (
    *CERTAINLY_HOSTILE,
    "replayed",
    "denied_connections",
    "denied",
    "expired",
    "flooded",
    "rosters",
    "other_swarm",
)
"""Counters of `Refused` to watch; the uncertain ones count effects of poor links and restarts, too."""


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
    """Version of the roster, which rises with each change; 0 if the node has no keys."""
    key_epoch: int = 0
    """Number of the group key."""
    swarm: str = ""
    root: str = ""
    """Fingerprint of the root that signed it."""
    members: tuple[RosterMemberState, ...] = ()
    revoked_self: bool = False
    """This node was revoked."""


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
class OtherSwarm(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Another swarm on the same network, received in the last minute."""

    root: str
    """The first four digits of the fingerprint of its root, or "" for nodes without keys."""
    datagrams: int
    """Number since it was received first."""
    addresses: tuple[str, ...]
    """Some of the addresses that they came from."""


@register
class Traffic(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Everything this node's broker sent and received since its start (board `net/traffic`).

    A multicast datagram counts once when sent, once at each receiver; with IP, UDP and TCP headers.
    """

    since_ns: int
    at_ns: int
    sent_bytes: int
    received_bytes: int
    udp_sent_bytes: int
    udp_received_bytes: int
    tcp_sent_bytes: int
    tcp_received_bytes: int
    sent_datagrams: int
    received_datagrams: int
    lost_datagrams: int
    sent_frames: int
    """Frames sent over ZeroMQ, including forwarded ones."""
    received_frames: int
    forwarded_frames: int
    requests: int
    """Requests from here that other platforms answered, each counted once."""
    notifications: int
    """Received values of other platforms' resources: by beacon for subscribed boards, in a tree's
    notifications, or as a message of kind notify, event or stream."""
    tick_hz: float
    refused: Refused
    links: tuple[LinkTraffic, ...] = ()
    channels: tuple[ChannelTraffic, ...] = ()
    failed_ticks: int = 0
    """Beacons that could not be composed or encoded and were skipped; the log has the place."""
    slowed_ticks: int = 0
    """Beacons that were delayed because the processor was overloaded."""
    slowdown: float = 1.0
    """Factor by which beacons are sent less often because the processor is overloaded; 1 without overload."""
    other_swarms: tuple[OtherSwarm, ...] = ()
    """Other swarms that this node receives."""


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
