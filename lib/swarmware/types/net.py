"""What the broker says about links, neighbours, routes and traffic, and what it is asked to carry."""

import msgspec

from swarmware.types.bounds import Count, Instant, Uint32
from swarmware.types.registry import register


@register
class NeighbourState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A node that is received directly."""

    platform: str
    """Empty as long as it has not said its name."""
    unit: str
    hardware: int
    kind: str
    """uav | ugv | usv | gcs | other."""
    state: str
    """heard (one way so far) | up | half_open (does not hear us) | down."""
    address: str
    """Where its datagrams come from, `host:port`."""
    since_ns: int
    """Our clock when it came into this state."""
    silent_s: float
    """Since its newest datagram."""
    tick_hz: float
    loss_in_ratio: float
    """Share of its last 16 datagrams that did not arrive here."""
    loss_out_ratio: float
    """Share of our datagrams that did not arrive there, as it says."""
    rtt_ms: float | None
    """Round trip of datagrams, without the time they were held; None: not measured yet."""
    cost: int
    """Expected transmissions in 1/256; 65535: no use."""
    tree_version: int
    mission: int
    boot_id: int
    transport: str
    """How messages go there: `tcp` (connected), `tcp connecting`, `tcp denied`, `idle` (nothing to send).
    Of its two connections, for commands and for data, the worse one."""
    multicast: bool
    """False: it is reached by unicast datagrams, as a seed or because it wrote to us."""


@register
class Neighbours(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All nodes heard within the last minutes (board `net/neighbours`)."""

    neighbours: tuple[NeighbourState, ...] = ()


@register
class RouteState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """How another node is reached."""

    platform: str
    """Its name, or its hardware id in hex as long as nobody said the name."""
    hardware: int
    via: str
    """Neighbour that leads there; the platform itself when it is one."""
    metric: int
    """256 for each hop without loss."""
    hops: int
    """Estimated from the metric; 1: direct."""
    tree_version: int
    since_ns: int
    """Our clock when the next hop was chosen."""


@register
class Routes(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All nodes that can be reached (board `net/routes`)."""

    routes: tuple[RouteState, ...] = ()


@register
class LinkTraffic(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Bytes of one link since the start; udp: with IP headers, tcp: of the frames alone, without those of
    connections, which `Traffic.tcp_sent_bytes` has as the kernel counts them."""

    platform: str
    """Neighbour; `*` for what is sent to all."""
    transport: str
    """udp | tcp."""
    sent_frames: int = 0
    sent_bytes: int = 0
    received_frames: int = 0
    received_bytes: int = 0
    lost: int = 0
    """Datagrams that never came."""
    late: int = 0
    """Datagrams overtaken by a later one."""
    duplicates: int = 0
    dropped: int = 0
    """Frames that we threw away: no room in the queue, or too old."""


@register
class ChannelTraffic(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Frames and payload bytes of one channel since the start."""

    channel: str
    """Resource path, or kind of a frame whose path nobody here knows."""
    offered_frames: int = 0
    """Values that were there to be sent."""
    offered_bytes: int = 0
    sent_frames: int = 0
    sent_bytes: int = 0
    received_frames: int = 0
    received_bytes: int = 0
    dropped: int = 0
    """Frames given up: no room in the queue, too old, denied."""
    late: int = 0
    """Older than what we had."""
    duplicates: int = 0
    max_hz: float | None = None
    """Limit in force."""
    held_back: int = 0
    """Values that the limit kept from being sent before a newer one came."""


@register
class Refused(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """What came from outside and was not taken, since the start."""

    forged: int = 0
    """Datagrams not sealed by our swarm."""
    replayed: int = 0
    old_session: int = 0
    """Datagrams of a session before the one that is believed."""
    unknown_session: int = 0
    """The sender's start was not heard yet: normal at the beginning."""
    other_epoch: int = 0
    malformed: int = 0
    spoofed: int = 0
    """Frames whose sender is not the member that sent them."""
    denied_connections: int = 0
    """Incoming TCP connections that ended before they proved a key of the roster."""
    looped: int = 0
    """Frames that came round again."""
    no_route: int = 0
    hop_limit: int = 0
    unheard: int = 0
    """Datagrams of platforms that `hear_only` leaves out; not counted as received."""
    expired: int = 0
    """Frames of others whose lifetime was over here: they are not passed on."""
    no_room: int = 0
    """Datagrams of senders beyond the limit of the neighbour table."""
    failed: int = 0
    """Datagrams on which this broker's own code failed; the log has the place."""
    denied: int = 0
    """Messages and requests whose sender's role may not send them."""
    unproven: int = 0
    """Datagrams whose sender had not yet answered us, or not proven that it started again."""
    flooded: int = 0
    """Datagrams left out before their seal was looked at: of strangers, or from where too many bad ones
    came; not counted as received."""


@register
class Denial(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A member asked for what its role may not (event `net/denials`)."""

    platform: str
    """Who asked, as its connection proved."""
    role: str
    verb: str
    path: str
    count: int
    """How often since the last report of the same."""
    reason: str


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
    """Over ZeroMQ, forwarded ones included."""
    received_frames: int
    forwarded_frames: int
    requests: int
    """Requests from here that other platforms answered, each counted once."""
    notifications: int
    """Values of other platforms' resources that came here: by beacon for subscribed boards, in a tree's
    notifications, or as a message of kind notify, event or stream."""
    tick_hz: float
    refused: Refused
    links: tuple[LinkTraffic, ...] = ()
    channels: tuple[ChannelTraffic, ...] = ()
    failed_ticks: int = 0
    """Beacons that could not be composed or encoded and were left out; the log has the place."""
    slowed_ticks: int = 0
    """Beacons that were due later than wanted, because the processor was overloaded."""
    slowdown: float = 1.0
    """Factor by which beacons are sent less often because the processor is overloaded; 1: it keeps up."""


@register
class TimingSample(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Clock differences read off one datagram, theirs minus ours."""

    platform: str
    unit: str
    hardware: int
    boot_id: int
    """Start of their clock: another one is another clock."""
    received_ns: Instant
    """Our clock at its arrival."""
    lower_ns: Instant
    """Their send time minus our receive time: their clock is at least so far ahead."""
    sent_ns: Instant = 0
    """Our clock when the datagram that they echo left."""
    upper_ns: Instant | None = None
    """Their receive time minus our send time of that one; None: no echo in this datagram."""


@register
class TimingBatch(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All clock differences since the last beacon (stream `net/timing`)."""

    samples: tuple[TimingSample, ...]


@register
class BoardPublication(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A board of this platform that others want."""

    path: str
    """Local path."""
    data_id: Uint32
    type: str
    min_interval_ms: Count = 0
    """Not more often than this; 0: every beacon."""


@register
class BoardSubscription(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A board of another platform that somebody here reads."""

    platform: str
    path: str
    """Local path on that platform."""
    type: str
    data_id: Uint32
    unit: str = "main"
    """Computer of that platform whose broker sends it."""


@register
class TreePlan(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """What the beacon shall carry: written by the tree, read by the broker (board `tree/plan`)."""

    tree_version: Uint32
    """Version of this platform's tree, told to all others."""
    offers: tuple[BoardPublication, ...] = ()
    wants: tuple[BoardSubscription, ...] = ()
    mission: Uint32 = 0
    """Digest of the active mission, told to neighbours; 0: none."""


@register
class SetChannel(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Limits the rate of all own boards whose path matches (`sys/broker/set_channel`)."""

    pattern: str
    """Of local paths: `nav/*`."""
    max_hz: float | None = None
    """0: nothing is sent; None: the limit is taken away."""
    for_s: float = 0.0
    """How long; 0: until it is changed or the broker ends."""


@register
class ChannelLimit(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A limit in force."""

    pattern: str
    max_hz: float
    remaining_s: float | None = None
    """None: no end."""


@register
class ChannelLimits(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All limits in force, the newest first: the first that matches counts (board `net/limits`)."""

    limits: tuple[ChannelLimit, ...] = ()
    unlimited: tuple[str, ...] = ()
    """Answer to a change: streams and events that match and go on as before, each item is promised."""
