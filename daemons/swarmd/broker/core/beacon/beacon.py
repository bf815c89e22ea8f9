"""The beacon: the periodic, sealed UDP datagram of a node, and the contents of its sections.

Specified in share/doc/protocol.md, section 3; tests compare the page with the codec.
"""

from enum import IntEnum
from typing import Final, NamedTuple

import msgspec

from swarmd.broker.core.beacon.parts.beacon_signature import BeaconSignature
from swarmd.broker.core.beacon.parts.medium_parts import MediumListing
from swarmd.broker.core.beacon.parts.session_checks import SessionCheck
from swarmd.broker.core.beacon.parts.solicitation import Solicitation
from swarmd.broker.core.beacon.parts.structure_parts import StructurePart
from swarmd.broker.core.beacon.parts.value_proof import ValueProof

NEVER_NS: Final = -(1 << 62)
"""Before every instant: clocks may be negative, simulated ones have offsets."""
BODY_LIMIT: Final = 1200
"""Limit of the body in bytes: with headers below the IPv6 minimum MTU of 1 280."""
INFINITY: Final = 0xFFFF
"""Metric of a retraction: the sender has lost its route."""
LOST: Final = 0x80
"""Flag in the hops of a sequence request."""
NO_ECHO: Final = 0xFF_FFFF
"""Hold time of an echo without a timestamp: it only lists the node as received."""
ANSWERED_SEQUENCES: Final = 256
"""An echo names the answered datagram by the low byte of its sequence number."""
HOPS_MAX: Final = 24
"""Maximum hops of a relayed value or a sequence request."""
AGE_UNIT_US: Final = 100
"""Resolution of a young age; an older one has 0.1 s. An age has 16 bits."""
_OLD: Final = 0x8000
_OLD_UNIT_US: Final = 100_000


class PlatformCode(IntEnum):
    """Kind of the platform of a node."""

    OTHER = 0
    UAV = 1
    UGV = 2
    USV = 3
    GCS = 4


class Header(msgspec.Struct, gc=False):
    """The clear header: selects the key, and is authenticated with the body."""

    epoch: int
    sender_hw: int
    sequence: int
    """Serves as replay counter, loss measure and route sequence number."""
    tx_us: int
    """Sender's hardware clock at send, 32-bit µs."""
    session: int | None = None
    """Greater after each start of the sender's broker; omitted in most datagrams."""


class Hello(msgspec.Struct, frozen=True, gc=False):
    """Identity and declared periods of the sender, every second or two."""

    boot_id: int
    """Boot id of the sender's hardware clock."""
    clock_high: int
    """The sender's clock in µs, shifted right by 32 bits: the upper part of `tx_us`."""
    tcp_port: int
    """Port of the ZeroMQ socket at the source address of the datagram, or 0 without a socket."""
    tree_version: int
    mission: int
    """Digest of the active mission, or 0 without a mission."""
    kind: PlatformCode
    name: str
    """Platform, or platform.unit where the unit is not `main`."""
    curve_public: bytes = b""
    """Only from nodes without a roster."""
    period_ms: int = 500
    """Declared maximum period between two beacons of the sender."""
    listing_ms: int = 3000
    """Declared period in which the sender lists every received node."""
    frame_port: int = 0
    """UDP port where the sender takes frames as datagrams, at the source address, or 0 if it takes none."""
    roster_version: int = 0
    """Version of the sender's roster, or 0 without a roster."""


class Echo(NamedTuple):
    """Listing of a received node with link quality and time echo (IHU of Babel)."""

    hw: int
    sequence: int
    """Low byte of the answered datagram's sequence number."""
    hold_us: int
    """From its reception to this datagram's `tx_us`, on the sender's clock; NO_ECHO: not given."""
    quality: int
    """Share of the last 16 datagrams that were received, in 1/255."""


class RouteRow(NamedTuple):
    """A route of the sender to a destination (Update of Babel)."""

    hw: int
    sequence: int
    """Newest sequence number of the destination that the sender knows, 16 bits."""
    metric: int
    """256 for a hop without loss; INFINITY: lost."""


class SequenceRequest(NamedTuple):
    """Request for a route with at least this sequence number (seqno request of Babel)."""

    hw: int
    sequence: int
    hops_left: int
    """With LOST: the sender has no route, so routes through it are lost too."""


class NeighbourRequest(NamedTuple):
    """Sequence request to one neighbour: for a newer row of a route that the sender could not use."""

    neighbour_hw: int
    """The neighbour that is asked; others ignore the request."""
    hw: int
    sequence: int
    hops_left: int


class MemberRow(msgspec.Struct, frozen=True, gc=False):
    """Name and tree version of a node that not all of the sender's neighbours receive."""

    hw: int
    tree_version: int
    kind: PlatformCode
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
    """Relayed value of another node's board, authenticated by its proof, or by the group key only."""

    origin_hw: int
    data_id: int
    stamp_us: int
    """Stamp on the origin's clock, 48-bit µs: decides which value is newer."""
    age_us: int
    """Sum of the ages on all hops."""
    hops: int
    """Hops from the origin to the receiver of this datagram."""
    packed: bool
    payload: bytes
    proof: ValueProof | None = None
    """Proof that the origin sent the value, in swarms with keys."""
    position: int = 0
    """Position among the values of the beacon to which the proof belongs."""


class Beacon(msgspec.Struct, frozen=True, gc=False):
    """The body of a beacon; each field is a section."""

    hello: Hello | None = None
    echoes: tuple[Echo, ...] = ()
    rows: tuple[RouteRow, ...] = ()
    requests: tuple[SequenceRequest, ...] = ()
    members: tuple[MemberRow, ...] = ()
    values: tuple[BoardValue, ...] = ()
    relays: tuple[RelayedValue, ...] = ()
    checks: tuple[SessionCheck, ...] = ()
    structure: StructurePart | None = None
    """Structure of the sender's tree."""
    structure_questions: tuple[int, ...] = ()
    """Hardware ids of nodes whose structure the sender needs."""
    signature: BeaconSignature | None = None
    """Signature of the sender, which is added after encoding."""
    media: tuple[MediumListing, ...] = ()
    """Media by which the sender receives its neighbours; empty from a node with one medium."""
    neighbour_requests: tuple[NeighbourRequest, ...] = ()
    solicitation: Solicitation | None = None
    """Neighbours that are overdue, and the time in which the sender answers."""


def encode_age(age_us: int) -> int:
    """Encodes an age: 0.1 ms up to 3.2 s, 0.1 s up to 54 min, which is the maximum."""
    fine = max(age_us, 0) // AGE_UNIT_US
    return fine if fine < _OLD else _OLD | min(age_us // _OLD_UNIT_US, _OLD - 1)


def decode_age(age: int) -> int:
    """Decodes an age, in µs."""
    return age * AGE_UNIT_US if age < _OLD else (age & ~_OLD) * _OLD_UNIT_US


class OutgoingBeacon(msgspec.Struct, frozen=True, gc=False):
    """The next beacon, before encoding."""

    sequence: int
    with_session: bool
    beacon: Beacon
    declared_period_ns: int = 0
    """Longest declared period, to be stored before sending, or 0 if it is unchanged."""
