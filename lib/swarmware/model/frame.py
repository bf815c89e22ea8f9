"""The frame: one 48-byte header and a payload, the same in shared memory, ipc, network and log."""

import struct
from enum import IntEnum, IntFlag
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.names import ANY

MAGIC: Final = b"SW"
VERSION: Final = 1
HEADER_BYTES: Final = 48
PAYLOAD_LIMIT: Final = 4 * 1024 * 1024
"""Largest payload of one frame on a link: libzmq's MAXMSGSIZE follows it; more is refused to its sender."""

EXTENSION_LIMIT: Final = 255
FRAME_LIMIT: Final = HEADER_BYTES + EXTENSION_LIMIT + PAYLOAD_LIMIT

_HEADER = struct.Struct("<2sBBHBBIIIIIIqII")
assert _HEADER.size == HEADER_BYTES
_MOVING = struct.Struct("<IqII")
_MOVING_AT: Final = HEADER_BYTES - _MOVING.size
"""Layout of the end of the header: sequence, stamp and echo times."""

KIND_AT: Final = 3
"""Offset of the kind in an encoded frame."""
HOPS_AT: Final = 6
"""Offset of the hops left in an encoded frame."""

HOPS: Final = 24
"""Hops a frame may take. Radios spread at random, each in range of nine others, are at most 14 hops apart
among 100 and 22 among 300; among 500 a few pairs are up to 26 apart."""


class FrameKind(IntEnum):
    """Purpose of a frame."""

    BOARD = 1
    MESSAGE = 2
    STREAM = 3
    FILE = 4
    ACK = 5
    REQUEST = 6
    REPLY = 7
    NOTIFY = 8
    BEACON = 9
    HELLO = 10
    ROUTE = 11
    EVENT = 12
    ROSTER = 13
    RTP = 14
    """A datagram of a video session: sent once, without an outcome."""


class Flag(IntFlag):
    """Header flags; bits 8–10 have the codec of the payload, the others are reserved."""

    URGENT = 2
    WANTS_ACK = 4
    BULK = 8
    """Part of something large: lowest priority on a link, whatever the kind."""


_URGENT: Final = int(Flag.URGENT)
_BULK: Final = int(Flag.BULK)
_WANTS_ACK: Final = int(Flag.WANTS_ACK)
"""The flags as integers: an operator of an enumeration takes ten times as long."""


class Codec(IntEnum):
    """Coding of the payload, applied to the MessagePack of its type."""

    NONE = 0
    ZLIB = 1
    ZSTD = 2
    PACKED = 7
    """The type's own quantised form instead of MessagePack."""


ADDRESSED: Final = frozenset(
    {
        *(FrameKind.BOARD, FrameKind.MESSAGE, FrameKind.STREAM, FrameKind.FILE),
        *(FrameKind.NOTIFY, FrameKind.EVENT),
    }
)
"""Kinds that are addressed to an inbox; the kind sets the priority on a link."""


_CODEC_SHIFT: Final = 8
_CODEC_MASK: Final = 0x7 << _CODEC_SHIFT
_CODECS: Final = {int(codec): codec for codec in Codec}
_KINDS: Final = {int(kind): kind for kind in FrameKind}
_PLAIN: Final = Codec.NONE


class Frame(msgspec.Struct, gc=False):
    """One unit of transported data."""

    kind: FrameKind
    data_id: int
    """Id of resource path and type, see `names.data_id`."""
    sender_hw: int = 0
    sender_app: int = 0
    receiver_hw: int = ANY
    receiver_app: int = ANY
    sequence: int = 0
    """Sequence number per (sender, data id), modulo 2³²."""
    stamp_ns: int = 0
    """Sender's hardware clock at send."""
    echo_tx_us: int = 0
    """The receiver's last send time, 32-bit µs of the receiver's clock."""
    echo_rx_us: int = 0
    """Arrival time of that frame, 32-bit µs of the sender's clock."""
    flags: int = 0
    codec: Codec = Codec.NONE
    hops_left: int = HOPS
    extension: bytes = b""
    payload: bytes | memoryview = b""

    @property
    def is_urgent(self) -> bool:
        """Whether the frame has priority over all frames that are not urgent."""
        return bool(self.flags & _URGENT)

    @property
    def is_bulk(self) -> bool:
        """Whether all other frames have priority over it."""
        return bool(self.flags & _BULK)

    @property
    def wants_ack(self) -> bool:
        """Whether its sender asked for an acknowledgement."""
        return bool(self.flags & _WANTS_ACK)


def encode(frame: Frame) -> bytes:
    """Encode a frame.

    Raises: WireError when a number does not fit its field of the header.
    """
    header = encode_header(frame, frame.hops_left, len(frame.extension))
    # a join takes views as well: the payload is not copied before
    return b"".join((header, frame.extension, frame.payload))


def encode_header(frame: Frame, hops_left: int, extension_bytes: int) -> bytes:
    """Encode the header of a frame, with these hops left and an extension of this length.

    Raises: WireError when a number does not fit its field.
    """
    try:
        return _HEADER.pack(
            MAGIC,
            VERSION,
            frame.kind,
            frame.flags | frame.codec << _CODEC_SHIFT,
            hops_left,
            extension_bytes,
            frame.data_id,
            frame.sender_hw,
            frame.sender_app,
            frame.receiver_hw,
            frame.receiver_app,
            frame.sequence & 0xFFFF_FFFF,
            frame.stamp_ns,
            frame.echo_tx_us & 0xFFFF_FFFF,
            frame.echo_rx_us & 0xFFFF_FFFF,
        )
    except struct.error as error:
        # the field is searched only after the failure: a check before it would cost every frame
        raise WireError(_range_error(frame)) from error


def encoded_bytes(frame: Frame) -> int:
    """Length of the encoded frame."""
    return HEADER_BYTES + len(frame.extension) + len(frame.payload)


def restamp(
    frame: bytearray, sequence: int, stamp_ns: int, *, echo_tx_us: int = 0, echo_rx_us: int = 0
) -> None:
    """Replace sequence number and times of an encoded frame, in place.

    Raises: WireError when the stamp does not fit its field.
    """
    try:
        # the moving fields are the last ones of the header, so that one slice replaces them all
        frame[_MOVING_AT:HEADER_BYTES] = _MOVING.pack(
            sequence & 0xFFFF_FFFF,
            stamp_ns,
            echo_tx_us & 0xFFFF_FFFF,
            echo_rx_us & 0xFFFF_FFFF,
        )
    except struct.error as error:
        raise WireError(f"frame: stamp_ns is {stamp_ns}: expected 64 bits") from error


_RANGES: Final = {
    "data_id": (0, ANY),
    "sender_hw": (0, ANY),
    "sender_app": (0, ANY),
    "receiver_hw": (0, ANY),
    "receiver_app": (0, ANY),
    "stamp_ns": (-(2**63), 2**63 - 1),
    "hops_left": (0, 255),
    "flags": (0, 0xFFFF),
}


def _range_error(frame: Frame) -> str:
    for name, (low, high) in _RANGES.items():
        number = getattr(frame, name)
        if not low <= number <= high:
            return f"frame: {name} is {number}: expected {low} to {high}"
    return f"frame: an extension of {len(frame.extension)} bytes: expected at most {EXTENSION_LIMIT}"


def decode(data: bytes | memoryview) -> Frame:
    """Decode a frame; the payload is a slice of the input (bytes of bytes, a view of a view).

    Raises: WireError for anything but a frame of a supported version.
    """
    # before unpacking, which would raise an error of its own for a short frame
    if len(data) < HEADER_BYTES:
        raise WireError(f"frame of {len(data)} bytes: expected at least {HEADER_BYTES}")
    (
        magic,
        version,
        kind_number,
        flags,
        hops_left,
        extension_length,
        data_id,
        sender_hw,
        sender_app,
        receiver_hw,
        receiver_app,
        sequence,
        stamp_ns,
        echo_tx_us,
        echo_rx_us,
    ) = _HEADER.unpack_from(data)
    if magic != MAGIC:
        raise WireError(f"frame starts with {magic!r}: expected {MAGIC!r}")
    # One version on either side, so that a swarm can be updated node by node.
    if not VERSION - 1 <= version <= VERSION + 1:
        raise WireError(f"frame of version {version}: expected {VERSION}, one before or one after")
    kind = _KINDS.get(kind_number)
    if kind is None:
        raise WireError(f"frame of unknown kind {kind_number}: expected one of {sorted(_KINDS)}")
    codec = _PLAIN
    # most frames are not compressed, and need no look-up
    if flags & _CODEC_MASK:
        coded = _CODECS.get((flags & _CODEC_MASK) >> _CODEC_SHIFT)
        if coded is None:
            raise WireError(f"frame of unknown codec {(flags & _CODEC_MASK) >> _CODEC_SHIFT}")
        codec, flags = coded, flags & ~_CODEC_MASK
    start = HEADER_BYTES + extension_length
    # the length of the extension comes from outside
    if len(data) < start:
        raise WireError(f"frame of {len(data)} bytes: its extension needs {start}")
    return Frame(
        kind,
        data_id,
        sender_hw,
        sender_app,
        receiver_hw,
        receiver_app,
        sequence,
        stamp_ns,
        echo_tx_us,
        echo_rx_us,
        flags,
        codec,
        hops_left,
        bytes(data[HEADER_BYTES:start]) if extension_length else b"",
        data[start:],
    )
