"""The beacon: the periodic, sealed UDP datagram of a node, and what its sections contain.

Specified in share/doc/protocol.md, section 3; tests compare the page with the codec.
"""

from enum import IntEnum
from typing import Final, NamedTuple

import msgspec

from swarmd.broker.core.session_checks import SessionCheck

NEVER_NS: Final = -(1 << 62)
"""Before every instant: a clock may well be below zero, simulated ones have offsets."""
BODY_LIMIT: Final = 1200
"""Bytes of body in one datagram: with headers below the 1 280 that every IPv6 path carries unbroken."""
INFINITY: Final = 0xFFFF
"""Metric of a destination that the sender cannot reach any more."""
LOST: Final = 0x80
"""Mark in the hops of a sequence request."""
NO_ECHO: Final = 0xFF_FFFF
"""Hold time of an echo that only says `I hear you`."""
ANSWERED_SEQUENCES: Final = 256
"""An echo names the datagram by the low byte of its sequence number."""
HOPS_MAX: Final = 24
"""Longest way of a relayed value or a sequence request."""


class PlatformKind(IntEnum):
    """What sort of platform a node belongs to."""

    OTHER = 0
    UAV = 1
    UGV = 2
    USV = 3
    GCS = 4


class Header(msgspec.Struct, gc=False):
    """The clear part: enough to find the key, authenticated with the rest."""

    epoch: int
    sender_hw: int
    sequence: int
    """Hello, replay counter, loss meter and route sequence number at once."""
    tx_us: int
    """Sender's hardware clock at send, 32-bit µs."""
    session: int | None = None
    """Rises with each start of the sender's broker; left out of most datagrams."""


class Hello(msgspec.Struct, frozen=True, gc=False):
    """Who the sender is, every second or two."""

    boot_id: int
    """Of the sender's hardware clock."""
    clock_high: int
    """The sender's clock in µs, shifted right by 32: makes `tx_us` whole."""
    tcp_port: int
    """Where its ZeroMQ socket listens, at the datagram's source address; 0: nowhere."""
    tree_version: int
    mission: int
    """Digest of the active mission; 0: none."""
    kind: PlatformKind
    name: str
    """Platform, or platform.unit where the unit is not `main`."""
    curve_public: bytes = b""
    """Only from nodes without a roster."""
    period_ms: int = 500
    """Longest time between two datagrams of the sender at present."""
    listing_ms: int = 3000
    """Everybody whom the sender hears has an echo at least this often."""


class Echo(NamedTuple):
    """`I hear you`, and when: listing, link quality and time echo in one."""

    hw: int
    sequence: int
    """Low byte of the answered datagram's sequence number."""
    hold_us: int
    """From its arrival to this datagram's `tx_us`, both on the sender's clock; NO_ECHO: not given."""
    quality: int
    """Share of the last 16 datagrams that arrived, in 1/255."""


class RouteRow(NamedTuple):
    """The sender reaches this destination."""

    hw: int
    sequence: int
    """Newest sequence number of the destination that the sender knows, 16 bits."""
    metric: int
    """256 for a hop without loss; INFINITY: lost."""


class SequenceRequest(NamedTuple):
    """Somebody needs a route to a destination with at least this sequence number."""

    hw: int
    sequence: int
    hops_left: int
    """With LOST: the sender itself has no route, so whoever goes through it has none either."""


class MemberRow(msgspec.Struct, frozen=True, gc=False):
    """Name and tree of a node that not all of the sender's neighbours hear."""

    hw: int
    tree_version: int
    kind: PlatformKind
    name: str


class BoardValue(msgspec.Struct, frozen=True, gc=False):
    """Newest value of one of the sender's own boards."""

    data_id: int
    age_us: int
    """Age at `tx_us`."""
    packed: bool
    """The type's quantised form instead of MessagePack."""
    payload: bytes


class RelayedValue(msgspec.Struct, frozen=True, gc=False):
    """A board of another node, passed on: hearsay under group trust."""

    origin_hw: int
    data_id: int
    stamp_us: int
    """Origin's clock, 48-bit µs: tells newer from older."""
    age_us: int
    """Summed up over the way."""
    hops: int
    """Hops from the origin to the receiver of this datagram."""
    packed: bool
    payload: bytes


class Beacon(msgspec.Struct, frozen=True, gc=False):
    """The body of one datagram."""

    hello: Hello | None = None
    echoes: tuple[Echo, ...] = ()
    rows: tuple[RouteRow, ...] = ()
    requests: tuple[SequenceRequest, ...] = ()
    members: tuple[MemberRow, ...] = ()
    values: tuple[BoardValue, ...] = ()
    relays: tuple[RelayedValue, ...] = ()
    checks: tuple[SessionCheck, ...] = ()
