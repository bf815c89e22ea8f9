"""The beacon: the periodic, sealed UDP datagram of a node, with everything that is sent at regular times.

share/doc/protocol.md is the description for other implementers; both are held together by tests.
"""

import struct
from enum import IntEnum
from typing import Final, NamedTuple

import msgspec

from swarmd.broker.core import session_checks
from swarmd.broker.core.age import decode_age, encode_age
from swarmd.broker.core.session_checks import SessionCheck
from swarmware.errors import WireError

NEVER_NS: Final = -(1 << 62)
"""Before every instant: a clock may well be below zero, simulated ones have offsets."""
MAGIC: Final = 0x54
VERSION: Final = 1
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

_SESSION_FLAG: Final = 0x10
_EPOCH_MASK: Final = 0x0F
_VERSION_SHIFT: Final = 5

_HEADER: Final = struct.Struct("<BBIII")
_HEADER_SESSION: Final = struct.Struct("<BBIIIQ")
_HELLO: Final = struct.Struct("<QiHIIHHBB")
_ECHO: Final = struct.Struct("<IBHBB")
_ROW: Final = struct.Struct("<IHH")
_REQUEST: Final = struct.Struct("<IHB")
_MEMBER: Final = struct.Struct("<IIBB")
_VALUE: Final = struct.Struct("<IHB")
_RELAY: Final = struct.Struct("<IIIHHBB")

HEADER_BYTES: Final = _HEADER.size
SESSION_BYTES: Final = 8
ECHO_BYTES: Final = _ECHO.size
ROW_BYTES: Final = _ROW.size
REQUEST_BYTES: Final = _REQUEST.size
_CURVE_BYTES: Final = 32
_HOLD_AT: Final = 5
"""Place of the hold time in an echo."""
_PACKED: Final = 0x80
_LONG: Final = 0x7F


class Section:
    """Which parts a body has, in its first byte; they stand in this order.

    Plain numbers: an IntFlag would take half of the time of a decode.
    """

    HELLO: Final = 1
    ECHOES: Final = 2
    ROWS: Final = 4
    REQUESTS: Final = 8
    MEMBERS: Final = 16
    VALUES: Final = 32
    RELAYS: Final = 64
    EXTRA: Final = 128
    """Type, length, bytes, to the end: what few datagrams have; skipped where unknown."""


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


def encode_header(header: Header) -> bytes:
    """The clear part."""
    marks = VERSION << _VERSION_SHIFT | header.epoch
    if header.session is None:
        return _HEADER.pack(MAGIC, marks, header.sender_hw, header.sequence, header.tx_us & 0xFFFF_FFFF)
    return _HEADER_SESSION.pack(
        MAGIC,
        marks | _SESSION_FLAG,
        header.sender_hw,
        header.sequence,
        header.tx_us & 0xFFFF_FFFF,
        header.session,
    )


def decode_header(data: bytes) -> tuple[Header, int]:
    """The clear part and its length; the sealed part follows.

    Raises: WireError for anything that is no beacon of a version we speak.
    """
    try:
        magic, marks, sender_hw, sequence, tx_us = _HEADER.unpack_from(data)
        if magic != MAGIC or not VERSION - 1 <= marks >> _VERSION_SHIFT <= VERSION + 1:
            raise WireError(f"datagram starts with {data[:2].hex()}: expected a beacon of version {VERSION}")
        if not marks & _SESSION_FLAG:
            return Header(marks & _EPOCH_MASK, sender_hw, sequence, tx_us), HEADER_BYTES
        session = _HEADER_SESSION.unpack_from(data)[5]
    except struct.error as error:
        raise WireError(f"datagram of {len(data)} bytes: {error}") from None
    return Header(marks & _EPOCH_MASK, sender_hw, sequence, tx_us, session), HEADER_BYTES + SESSION_BYTES


def sender_of(data: bytes) -> int:
    """Sender of a datagram before anything else of it is looked at; 0 when it is too short."""
    return int.from_bytes(data[2:6], "little")


def value_bytes(payload: bytes) -> int:
    """Bytes that a value takes in the body."""
    return _VALUE.size + len(payload) + (2 if len(payload) >= _LONG else 0)


def relay_bytes(payload: bytes) -> int:
    """Bytes that a relayed value takes in the body."""
    return _RELAY.size + len(payload) + (2 if len(payload) >= _LONG else 0)


def member_bytes(member: MemberRow) -> int:
    """Bytes that a member row takes in the body."""
    return _MEMBER.size + len(member.name.encode())


def hello_bytes(hello: Hello) -> int:
    """Bytes that a hello takes in the body."""
    return 1 + _HELLO.size + len(hello.curve_public) + len(hello.name.encode())


def encode(beacon: Beacon) -> bytes:
    """The body as bytes; the caller keeps it below BODY_LIMIT.

    Raises: WireError when a list has more than 255 entries or a number does not fit its field.
    """
    try:
        return _encode(beacon)
    except (struct.error, ValueError, OverflowError) as error:
        raise WireError(f"beacon: cannot be encoded: {error}") from error


def _encode(beacon: Beacon) -> bytes:
    sections = 0
    out: list[bytes] = [b""]
    if beacon.hello is not None:
        sections |= Section.HELLO
        out.append(_encode_hello(beacon.hello))
    if beacon.echoes:
        sections |= Section.ECHOES
        out.append(bytes((len(beacon.echoes),)))
        out.extend(
            _ECHO.pack(hw, seq & 0xFF, hold & 0xFFFF, hold >> 16, q) for hw, seq, hold, q in beacon.echoes
        )
    if beacon.rows:
        sections |= Section.ROWS
        out.append(bytes((len(beacon.rows),)))
        out.extend([_ROW.pack(*row) for row in beacon.rows])
    if beacon.requests:
        sections |= Section.REQUESTS
        out.append(bytes((len(beacon.requests),)))
        out.extend([_REQUEST.pack(*request) for request in beacon.requests])
    if beacon.members:
        sections |= Section.MEMBERS
        out.append(bytes((len(beacon.members),)))
        for member in beacon.members:
            name = member.name.encode()
            out.append(_MEMBER.pack(member.hw, member.tree_version, member.kind, len(name)) + name)
    if beacon.values:
        sections |= Section.VALUES
        out.append(bytes((len(beacon.values),)))
        for value in beacon.values:
            size, long = _size(value.payload, value.packed)
            out += (_VALUE.pack(value.data_id, encode_age(value.age_us), size), long, value.payload)
    if beacon.relays:
        sections |= Section.RELAYS
        out.append(bytes((len(beacon.relays),)))
        for relay in beacon.relays:
            size, long = _size(relay.payload, relay.packed)
            stamp = relay.stamp_us & 0xFFFF_FFFF_FFFF
            head = _RELAY.pack(
                relay.origin_hw,
                relay.data_id,
                stamp & 0xFFFF_FFFF,
                stamp >> 32,
                encode_age(relay.age_us),
                relay.hops,
                size,
            )
            out += (head, long, relay.payload)
    if beacon.checks:
        sections |= Section.EXTRA
        out.append(session_checks.encode(beacon.checks))
    out[0] = bytes((sections,))
    return b"".join(out)


def shift_echoes(body: bytearray, late_us: int) -> None:
    """Adds to the hold time of all echoes in a body: it leaves later than it was composed."""
    at = 1
    if body[0] & Section.HELLO:
        at += 1 + body[1]
    if not body[0] & Section.ECHOES:
        return
    first = at + 1 + _HOLD_AT
    for hold in range(first, first + body[at] * ECHO_BYTES, ECHO_BYTES):
        hold_us = int.from_bytes(body[hold : hold + 3], "little")
        if hold_us != NO_ECHO:
            body[hold : hold + 3] = min(hold_us + late_us, NO_ECHO).to_bytes(3, "little")


def decode(data: bytes) -> Beacon:
    """The beacon in an opened body.

    Raises: WireError for anything that is none.
    """
    try:
        return _decode(data)
    except (struct.error, IndexError) as error:
        raise WireError(f"beacon of {len(data)} bytes: cut short: {error}") from None
    except UnicodeDecodeError as error:
        raise WireError(f"beacon: a name that is no UTF-8: {error}") from None


def _decode(data: bytes) -> Beacon:
    """One pass over the body; what is cut short raises, or leads behind the end."""
    sections = data[0]
    at = 1
    hello: Hello | None = None
    echoes: tuple[Echo, ...] = ()
    rows: tuple[RouteRow, ...] = ()
    requests: tuple[SequenceRequest, ...] = ()
    members: tuple[MemberRow, ...] = ()
    values: tuple[BoardValue, ...] = ()
    relays: tuple[RelayedValue, ...] = ()
    found: tuple[SessionCheck, ...] = ()
    if sections & Section.HELLO:
        hello, at = _decode_hello(data, at)
    if sections & Section.ECHOES:
        block, at = _block(data, at, ECHO_BYTES)
        echoes = tuple([Echo(h, s, lo | hi << 16, q) for h, s, lo, hi, q in _ECHO.iter_unpack(block)])
    if sections & Section.ROWS:
        block, at = _block(data, at, ROW_BYTES)
        rows = tuple([RouteRow(*row) for row in _ROW.iter_unpack(block)])
    if sections & Section.REQUESTS:
        block, at = _block(data, at, REQUEST_BYTES)
        requests = tuple([SequenceRequest(*request) for request in _REQUEST.iter_unpack(block)])
    if sections & Section.MEMBERS:
        members, at = _decode_members(data, at)
    if sections & Section.VALUES:
        values, at = _decode_values(data, at)
    if sections & Section.RELAYS:
        relays, at = _decode_relays(data, at)
    if sections & Section.EXTRA:
        found, at = session_checks.decode(data, at)
    if at < len(data):
        raise WireError(f"beacon: {len(data) - at} bytes after its last section")
    if at > len(data):
        raise WireError(f"beacon of {len(data)} bytes: its parts need {at}")
    return Beacon(hello, echoes, rows, requests, members, values, relays, found)


def _block(data: bytes, at: int, size: int) -> tuple[bytes, int]:
    end = at + 1 + data[at] * size
    return data[at + 1 : end], end


def _payload(data: bytes, at: int, mark: int) -> tuple[bytes, int]:
    length = mark & _LONG
    if length == _LONG:
        length = int.from_bytes(data[at : at + 2], "little")
        at += 2
    end = at + length
    return data[at:end], end


def _decode_hello(data: bytes, at: int) -> tuple[Hello, int]:
    end = at + 1 + data[at]
    boot_id, clock_high, tcp_port, tree_version, mission, period_ms, listing_ms, kind, key = (
        _HELLO.unpack_from(data, at + 1)
    )
    at += 1 + _HELLO.size
    if key not in (0, _CURVE_BYTES) or not at + key < end <= len(data):
        raise WireError(f"hello: a key of {key} bytes and a name up to byte {end} do not fit")
    hello = Hello(
        boot_id,
        clock_high,
        tcp_port,
        tree_version,
        mission,
        _platform_kind(kind),
        data[at + key : end].decode(),
        data[at : at + key],
        period_ms,
        listing_ms,
    )
    return hello, end


def _decode_members(data: bytes, at: int) -> tuple[tuple[MemberRow, ...], int]:
    members: list[MemberRow] = []
    count = data[at]
    at += 1
    for _ in range(count):
        hw, tree_version, kind, length = _MEMBER.unpack_from(data, at)
        at += _MEMBER.size
        name = data[at : at + length].decode()
        at += length
        members.append(MemberRow(hw, tree_version, _platform_kind(kind), name))
    return tuple(members), at


def _decode_values(data: bytes, at: int) -> tuple[tuple[BoardValue, ...], int]:
    values: list[BoardValue] = []
    count = data[at]
    at += 1
    for _ in range(count):
        data_id, age, mark = _VALUE.unpack_from(data, at)
        payload, at = _payload(data, at + _VALUE.size, mark)
        values.append(BoardValue(data_id, decode_age(age), mark >= _PACKED, payload))
    return tuple(values), at


def _decode_relays(data: bytes, at: int) -> tuple[tuple[RelayedValue, ...], int]:
    relays: list[RelayedValue] = []
    count = data[at]
    at += 1
    for _ in range(count):
        origin_hw, data_id, low, high, age, hops, mark = _RELAY.unpack_from(data, at)
        if not 1 <= hops <= HOPS_MAX:
            raise WireError(f"beacon: a relayed value of {hops} hops: expected 1 to {HOPS_MAX}")
        stamp_us = low | high << 32
        if high >= 0x8000:  # a clock before its zero: simulated ones have offsets
            stamp_us -= 1 << 48
        payload, at = _payload(data, at + _RELAY.size, mark)
        relays.append(
            RelayedValue(origin_hw, data_id, stamp_us, decode_age(age), hops, mark >= _PACKED, payload)
        )
    return tuple(relays), at


def _platform_kind(number: int) -> PlatformKind:
    try:
        return PlatformKind(number)
    except ValueError:
        return PlatformKind.OTHER


def _size(payload: bytes, packed: bool) -> tuple[int, bytes]:
    mark = _PACKED if packed else 0
    length = len(payload)
    if length < _LONG:
        return mark | length, b""
    return mark | _LONG, length.to_bytes(2, "little")


def _encode_hello(hello: Hello) -> bytes:
    body = (
        _HELLO.pack(
            hello.boot_id,
            hello.clock_high,
            hello.tcp_port,
            hello.tree_version,
            hello.mission,
            hello.period_ms,
            hello.listing_ms,
            hello.kind,
            len(hello.curve_public),
        )
        + hello.curve_public
        + hello.name.encode()
    )
    return bytes((len(body),)) + body
