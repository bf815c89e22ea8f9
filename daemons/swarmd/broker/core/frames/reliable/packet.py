"""Packets of a reliable link: pieces of messages, and acknowledgements of packets of the other direction."""

import struct
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.frame import FRAME_LIMIT

PACKET_MAX: Final = 1212
"""Limit of a packet: with header and tag its datagram has at most 1 238 bytes, as a beacon, and is never
fragmented."""
RANGES_MAX: Final = 32
"""Ranges in an acknowledgement, the newest ones."""
DELAY_UNIT_NS: Final = 16_000
"""Unit of the delay of an acknowledgement: 16 bits reach a second."""
_DELAY_MAX: Final = 0xFFFF

_HEAD: Final = struct.Struct("<II")
_ACK: Final = struct.Struct("<BIHBH")
_RANGE: Final = struct.Struct("<HH")
_PIECE: Final = struct.Struct("<BIIIH")
_WHOLE: Final = struct.Struct("<BIH")
_ACK_TAG: Final = 1
_PIECE_TAG: Final = 2
_WHOLE_TAG: Final = 3
_PING_TAG: Final = 4
_GAP_MAX: Final = 0xFFFF

HEAD_BYTES: Final = _HEAD.size
PIECE_BYTES: Final = _PIECE.size
WHOLE_BYTES: Final = _WHOLE.size
NUMBER_MAX: Final = 0xFFFF_FFFF


class Acknowledgement(msgspec.Struct, frozen=True, gc=False):
    """Packets that arrived: closed ranges of numbers, the newest first."""

    ranges: tuple[tuple[int, int], ...]
    """First and last number of each."""
    delay_ns: int
    """From the arrival of the newest packet to the sending of this acknowledgement."""

    @property
    def largest(self) -> int:
        """The highest number that arrived."""
        return self.ranges[0][1]


class Piece(msgspec.Struct, frozen=True, gc=False):
    """A piece of a message."""

    message: int
    """Number of the message, in the order in which messages begin."""
    total: int
    """Length of the message in bytes."""
    offset: int
    data: bytes


class Packet(msgspec.Struct, frozen=True, gc=False):
    """The content of one datagram."""

    number: int
    floor: int
    """All messages before this number are complete: no piece of them follows."""
    acknowledgement: Acknowledgement | None = None
    pieces: tuple[Piece, ...] = ()
    ping: bool = False
    """The packet asks for an acknowledgement, also without pieces."""

    @property
    def is_answered(self) -> bool:
        """Whether its receiver acknowledges it."""
        return self.ping or bool(self.pieces)


def encode(packet: Packet) -> bytes:
    """The packet as bytes."""
    parts = [_HEAD.pack(packet.number, packet.floor)]
    if packet.acknowledgement is not None:
        parts.append(_encode_acknowledgement(packet.acknowledgement))
    for piece in packet.pieces:
        if len(piece.data) == piece.total:
            parts.append(_WHOLE.pack(_WHOLE_TAG, piece.message, piece.total))
        else:
            parts.append(_PIECE.pack(_PIECE_TAG, piece.message, piece.total, piece.offset, len(piece.data)))
        parts.append(piece.data)
    if packet.ping:
        parts.append(bytes((_PING_TAG,)))
    return b"".join(parts)


def piece_bytes(piece: Piece) -> int:
    """Bytes of a piece in a packet."""
    return len(piece.data) + (WHOLE_BYTES if len(piece.data) == piece.total else PIECE_BYTES)


def acknowledgement_bytes(acknowledgement: Acknowledgement) -> int:
    """Bytes of an acknowledgement in a packet."""
    return _ACK.size + (min(len(acknowledgement.ranges), RANGES_MAX) - 1) * _RANGE.size


def _encode_acknowledgement(acknowledgement: Acknowledgement) -> bytes:
    first, largest = acknowledgement.ranges[0]
    ranges: list[bytes] = []
    low = first
    for start, end in acknowledgement.ranges[1:RANGES_MAX]:
        gap, length = low - end - 1, end - start
        if gap > _GAP_MAX or length > _GAP_MAX:
            break  # older ranges may be left out
        ranges.append(_RANGE.pack(gap, length))
        low = start
    delay = min(acknowledgement.delay_ns // DELAY_UNIT_NS, _DELAY_MAX)
    head = _ACK.pack(_ACK_TAG, largest, delay, len(ranges), min(largest - first, _GAP_MAX))
    return head + b"".join(ranges)


def decode(data: bytes) -> Packet:
    """Decode a packet.

    Raises: WireError for anything but a packet, and nothing else.
    """
    if len(data) < HEAD_BYTES:
        raise WireError(f"packet of {len(data)} bytes: expected at least {HEAD_BYTES}")
    number, floor = _HEAD.unpack_from(data)
    at, size = HEAD_BYTES, len(data)
    acknowledgement: Acknowledgement | None = None
    pieces: list[Piece] = []
    ping = False
    try:
        while at < size:
            tag = data[at]
            if tag == _PIECE_TAG:
                _, message, total, offset, length = _PIECE.unpack_from(data, at)
                at += PIECE_BYTES
                pieces.append(_piece(message, total, offset, data[at : at + length], length))
                at += length
            elif tag == _WHOLE_TAG:
                _, message, length = _WHOLE.unpack_from(data, at)
                at += WHOLE_BYTES
                pieces.append(_piece(message, length, 0, data[at : at + length], length))
                at += length
            elif tag == _ACK_TAG and acknowledgement is None:
                acknowledgement, at = _decode_acknowledgement(data, at)
            elif tag == _PING_TAG:
                ping = True
                at += 1
            else:
                raise WireError(f"packet: element {tag} at byte {at}: expected 1 to 4")
    except struct.error as error:
        raise WireError(f"packet of {size} bytes: it ends within an element") from error
    return Packet(number, floor, acknowledgement, tuple(pieces), ping)


def _piece(message: int, total: int, offset: int, data: bytes, length: int) -> Piece:
    if len(data) != length or not length:
        raise WireError(f"piece of message {message}: {len(data)} bytes; expected {length}, not none")
    if total > FRAME_LIMIT or offset + length > total:
        raise WireError(f"piece of message {message}: bytes {offset} to {offset + length} of {total}")
    return Piece(message, total, offset, data)


def _decode_acknowledgement(data: bytes, at: int) -> tuple[Acknowledgement, int]:
    _, largest, delay, count, length = _ACK.unpack_from(data, at)
    at += _ACK.size
    low = largest - length
    ranges = [(low, largest)]
    for _ in range(count):
        gap, length = _RANGE.unpack_from(data, at)
        at += _RANGE.size
        end = low - gap - 1
        low = end - length
        ranges.append((low, end))
    if low < 0:
        raise WireError("acknowledgement: it reaches below packet 0")
    return Acknowledgement(tuple(ranges), delay * DELAY_UNIT_NS), at
