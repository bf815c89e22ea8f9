"""Traffic of the broker: bytes and frames of links and channels, refused input, pace of the beacons."""

from typing import Final

import msgspec

from swarmware.types.net import LinkTransport
from swarmware.types.registry import register


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
    """Throughput to the neighbour while the link was the limit, with headers, udp only, or None if it never
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
