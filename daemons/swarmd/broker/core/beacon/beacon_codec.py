"""The beacon as bytes: the clear header, and the body with its sections.

Specified in share/doc/protocol.md, section 3; tests compare the page with this file.
"""

import struct
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import msgspec

from swarmd.broker.core.beacon import proof_parts, request_parts
from swarmd.broker.core.beacon.beacon import (
    HOPS_MAX,
    NO_ECHO,
    Beacon,
    BoardValue,
    Echo,
    Header,
    Hello,
    MemberRow,
    PlatformCode,
    RelayedValue,
    RouteRow,
    SequenceRequest,
    decode_age,
    encode_age,
)
from swarmd.broker.core.beacon.parts import (
    beacon_signature,
    medium_parts,
    session_checks,
    solicitation,
    structure_parts,
)
from swarmware.errors import WireError

MAGIC: Final = 0x54
VERSION: Final = 1
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
"""Offset of the hold time in an echo."""
_PACKED: Final = 0x80
_LONG: Final = 0x7F


class Section:
    """Bits of the sections in the first byte of a body.

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
    """Parts of type, length and bytes up to the end; unknown types are skipped."""


def encode_header(header: Header) -> bytes:
    """Encodes the clear header."""
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
    """Decodes the clear header; returns it and its length.

    Raises: WireError for anything but a beacon of a supported version.
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
    """Sender of a datagram before it is decoded, or 0 if it is too short."""
    return int.from_bytes(data[2:6], "little")


def value_bytes(payload: bytes) -> int:
    """Encoded size of a board value."""
    return _VALUE.size + len(payload) + (2 if len(payload) >= _LONG else 0)


def relay_bytes(payload: bytes) -> int:
    """Encoded size of a relayed value."""
    return _RELAY.size + len(payload) + (2 if len(payload) >= _LONG else 0)


def member_bytes(member: MemberRow) -> int:
    """Encoded size of a member row."""
    return _MEMBER.size + len(member.name.encode())


def hello_bytes(hello: Hello) -> int:
    """Encoded size of a hello."""
    parts = session_checks.PORT_PART_BYTES if hello.frame_port else 0
    parts += session_checks.ROSTER_PART_BYTES if hello.roster_version else 0
    return 1 + _HELLO.size + len(hello.curve_public) + len(hello.name.encode()) + parts


def encode(beacon: Beacon) -> bytes:
    """Encodes the body; the caller keeps it below BODY_LIMIT.

    Raises: WireError when a list has more than 255 entries or a number does not fit its field.
    """
    present = 0
    out = [b""]
    try:
        for section, content in zip(_SECTIONS, msgspec.structs.astuple(beacon), strict=False):
            if content:
                present |= section.bit
                out.append(section.encode(content))
        if beacon.hello is not None and beacon.hello.frame_port:
            present |= Section.EXTRA
            out.append(session_checks.encode_port(beacon.hello.frame_port))
        if beacon.hello is not None and beacon.hello.roster_version:
            present |= Section.EXTRA
            out.append(session_checks.encode_roster_version(beacon.hello.roster_version))
        if beacon.structure is not None:
            present |= Section.EXTRA
            out.append(structure_parts.encode_structure(beacon.structure))
        if beacon.structure_questions:
            present |= Section.EXTRA
            out.append(structure_parts.encode_questions(beacon.structure_questions))
        if beacon.media:
            present |= Section.EXTRA
            out.append(medium_parts.encode_media(beacon.media))
        if beacon.neighbour_requests:
            present |= Section.EXTRA
            out.append(request_parts.encode_requests(beacon.neighbour_requests))
        if beacon.solicitation is not None:
            present |= Section.EXTRA
            out.append(solicitation.encode_solicitation(beacon.solicitation))
        if proofs := proof_parts.encode_proofs(beacon.relays):
            present |= Section.EXTRA
            out.append(proofs)
    except (struct.error, ValueError, OverflowError) as error:
        raise WireError(f"beacon: cannot be encoded: {error}") from error
    out[0] = bytes((present,))
    return b"".join(out)


def append_statement(body: bytes | bytearray, statement: bytes) -> bytes:
    """A body with an extra part behind its last one."""
    return bytes((body[0] | Section.EXTRA,)) + bytes(body[1:]) + statement


def shift_echoes(body: bytearray, late_us: int) -> None:
    """Adds the time since composition to the hold times of all echoes in a body."""
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
    """Decodes a decrypted body.

    Raises: WireError for bytes that are not a body.
    """
    try:
        return _decode(data)
    except (struct.error, IndexError) as error:
        raise WireError(f"beacon of {len(data)} bytes: cut short: {error}") from None
    except UnicodeDecodeError as error:
        raise WireError(f"beacon: a name that is not UTF-8: {error}") from None


def _decode(data: bytes) -> Beacon:
    """One pass over the body: a section that is cut short raises, or ends behind the body."""
    present = data[0]
    at = start = 1
    contents = list(_ABSENT)
    for index, (bit, _, decode_section) in enumerate(_SECTIONS):
        if present & bit:
            start = at
            contents[index], at = decode_section(data, at)
    if at < len(data):
        raise WireError(f"beacon: {len(data) - at} bytes after its last section")
    if at > len(data):
        raise WireError(f"beacon of {len(data)} bytes: its sections need {at}")
    if present & Section.EXTRA:
        contents[_STRUCTURE], contents[_QUESTIONS] = structure_parts.decode(data, start)
        contents[_SIGNATURE] = beacon_signature.decode(data, start)
        contents[_MEDIA] = medium_parts.decode_media(data, start)
        contents[_RELAYS] = proof_parts.decode_proofs(data, start, contents[_RELAYS])
        contents[_NEIGHBOUR_REQUESTS] = request_parts.decode_requests(data, start)
        contents[_SOLICITATION] = solicitation.decode_solicitation(data, start)
    if present & Section.EXTRA and present & Section.HELLO:
        port, version = session_checks.decode_hello_parts(data, start)
        contents[0] = msgspec.structs.replace(contents[0], frame_port=port, roster_version=version)
    return Beacon(*contents)


# sections


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


def _encode_echoes(echoes: tuple[Echo, ...]) -> bytes:
    packed = [_ECHO.pack(hw, seq & 0xFF, hold & 0xFFFF, hold >> 16, q) for hw, seq, hold, q in echoes]
    return bytes((len(echoes),)) + b"".join(packed)


def _decode_echoes(data: bytes, at: int) -> tuple[tuple[Echo, ...], int]:
    block, at = _block(data, at, ECHO_BYTES)
    return tuple([Echo(h, s, lo | hi << 16, q) for h, s, lo, hi, q in _ECHO.iter_unpack(block)]), at


def _encode_rows(rows: tuple[RouteRow, ...]) -> bytes:
    return bytes((len(rows),)) + b"".join([_ROW.pack(*row) for row in rows])


def _decode_rows(data: bytes, at: int) -> tuple[tuple[RouteRow, ...], int]:
    block, at = _block(data, at, ROW_BYTES)
    return tuple([RouteRow(*row) for row in _ROW.iter_unpack(block)]), at


def _encode_requests(requests: tuple[SequenceRequest, ...]) -> bytes:
    return bytes((len(requests),)) + b"".join([_REQUEST.pack(*request) for request in requests])


def _decode_requests(data: bytes, at: int) -> tuple[tuple[SequenceRequest, ...], int]:
    block, at = _block(data, at, REQUEST_BYTES)
    return tuple([SequenceRequest(*request) for request in _REQUEST.iter_unpack(block)]), at


def _encode_members(members: tuple[MemberRow, ...]) -> bytes:
    out = [bytes((len(members),))]
    for member in members:
        name = member.name.encode()
        out.append(_MEMBER.pack(member.hw, member.tree_version, member.kind, len(name)) + name)
    return b"".join(out)


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


def _encode_values(values: tuple[BoardValue, ...]) -> bytes:
    out = [bytes((len(values),))]
    for value in values:
        size, long = _size(value.payload, value.packed)
        out += (_VALUE.pack(value.data_id, encode_age(value.age_us), size), long, value.payload)
    return b"".join(out)


def _decode_values(data: bytes, at: int) -> tuple[tuple[BoardValue, ...], int]:
    values: list[BoardValue] = []
    count = data[at]
    at += 1
    for _ in range(count):
        data_id, age, mark = _VALUE.unpack_from(data, at)
        payload, at = _payload(data, at + _VALUE.size, mark)
        values.append(BoardValue(data_id, decode_age(age), mark >= _PACKED, payload))
    return tuple(values), at


def _encode_relays(relays: tuple[RelayedValue, ...]) -> bytes:
    out = [bytes((len(relays),))]
    for relay in relays:
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
    return b"".join(out)


def _decode_relays(data: bytes, at: int) -> tuple[tuple[RelayedValue, ...], int]:
    relays: list[RelayedValue] = []
    count = data[at]
    at += 1
    for _ in range(count):
        origin_hw, data_id, low, high, age, hops, mark = _RELAY.unpack_from(data, at)
        if not 1 <= hops <= HOPS_MAX:
            raise WireError(f"beacon: a relayed value of {hops} hops: expected 1 to {HOPS_MAX}")
        stamp_us = low | high << 32
        if high >= 0x8000:  # negative clock: simulated ones have offsets
            stamp_us -= 1 << 48
        payload, at = _payload(data, at + _RELAY.size, mark)
        relays.append(
            RelayedValue(origin_hw, data_id, stamp_us, decode_age(age), hops, mark >= _PACKED, payload)
        )
    return tuple(relays), at


def _platform_kind(number: int) -> PlatformCode:
    try:
        return PlatformCode(number)
    except ValueError:
        return PlatformCode.OTHER


def _size(payload: bytes, packed: bool) -> tuple[int, bytes]:
    mark = _PACKED if packed else 0
    length = len(payload)
    if length < _LONG:
        return mark | length, b""
    return mark | _LONG, length.to_bytes(2, "little")


class _Section(NamedTuple):
    """A section of the body: its bit in the first byte and both directions of its codec."""

    bit: int
    encode: Callable[[Any], bytes]
    decode: Callable[[bytes, int], tuple[Any, int]]
    """Maps the body and the offset of the section to its content and the offset behind it."""


_SECTIONS: Final = (
    _Section(Section.HELLO, _encode_hello, _decode_hello),
    _Section(Section.ECHOES, _encode_echoes, _decode_echoes),
    _Section(Section.ROWS, _encode_rows, _decode_rows),
    _Section(Section.REQUESTS, _encode_requests, _decode_requests),
    _Section(Section.MEMBERS, _encode_members, _decode_members),
    _Section(Section.VALUES, _encode_values, _decode_values),
    _Section(Section.RELAYS, _encode_relays, _decode_relays),
    _Section(Section.EXTRA, session_checks.encode, session_checks.decode),
)
"""Sections in the order of the body and of the first fields of `Beacon`; the fields after them are extra
parts."""
_RELAYS: Final = 6
_STRUCTURE, _QUESTIONS, _SIGNATURE, _MEDIA, _NEIGHBOUR_REQUESTS, _SOLICITATION = range(
    len(_SECTIONS), len(_SECTIONS) + 6
)
"""Fields of `Beacon` behind the sections."""
_ABSENT: Final = msgspec.structs.astuple(Beacon())
