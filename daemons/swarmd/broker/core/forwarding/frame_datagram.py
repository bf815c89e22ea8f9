"""Frames as datagrams: selection, packing, and the clear header."""

import struct
import zlib
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.frame import Codec, Flag, Frame, encode, encoded_bytes
from swarmware.transport.delivery.signature import is_signed

MAGIC: Final = 0x55
FRAME: Final = 1
"""The datagram is a frame."""
PACKET: Final = 2
"""The datagram is a packet of the reliable link."""
_HEADER: Final = struct.Struct("<BBII")
HEADER_BYTES: Final = _HEADER.size
FRAME_MAX: Final = 1212
"""Limit of the frame: with header and tag a datagram has at most 1 238 bytes, as a beacon, and is never
fragmented."""
COMPRESS_MAX: Final = 16_384
"""Maximum payload that is compressed: text shrinks to a third, so longer ones do not fit a datagram."""
_LEVEL: Final = 1
_WINDOW_BITS: Final = 12
_MEMORY_LEVEL: Final = 5
"""An order of 2.5 kB becomes 0.9 kB in 8 µs; with zlib's defaults, whose 256 KiB are mapped again for each
call, in 20 µs to 400 µs."""
SEQUENCE_MAX: Final = 0xFFFF_FFFF
MISSES: Final = 2
"""Consecutive datagrams with retransmitted frames after which the path counts as blocked."""
RETRY_NS: Final = 60_000_000_000
"""Period after which a neighbour gets datagrams again."""


def pack(frame: Frame) -> bytes | None:
    """The encoded frame if it may be sent as a datagram: urgent, and small enough, if necessary
    compressed; a signed frame stays as it is."""
    if not frame.flags & Flag.URGENT or len(frame.payload) > COMPRESS_MAX:
        return None
    data = encode(frame)
    if len(data) > FRAME_MAX and not is_signed(frame.extension):
        data = encode(compressed(frame))
    return data if len(data) <= FRAME_MAX else None


def compressed(frame: Frame, added_bytes: int = 0) -> Frame:
    """The frame with a compressed payload if a datagram needs that; `added_bytes`: what it will grow by."""
    size = encoded_bytes(frame) + added_bytes
    if (
        size <= FRAME_MAX
        or not frame.flags & Flag.URGENT
        or frame.codec is not Codec.NONE
        or len(frame.payload) > COMPRESS_MAX
    ):
        return frame
    return msgspec.structs.replace(frame, codec=Codec.ZLIB, payload=_compress(frame.payload))


def _compress(payload: bytes | memoryview) -> bytes:
    compressor = zlib.compressobj(_LEVEL, zlib.DEFLATED, _WINDOW_BITS, _MEMORY_LEVEL)
    return compressor.compress(payload) + compressor.flush()


def encode_header(content: int, sender_hw: int, sequence: int) -> bytes:
    """Encodes the clear header; `content`: FRAME or PACKET."""
    return _HEADER.pack(MAGIC, content, sender_hw, sequence)


def decode_header(data: bytes) -> tuple[int, int, int]:
    """Content, sender and sequence number in the clear header.

    Raises: WireError for anything but a datagram with a frame or a packet.
    """
    if len(data) <= HEADER_BYTES:
        raise WireError(f"datagram of {len(data)} bytes: expected a frame of more than {HEADER_BYTES}")
    magic, content, sender_hw, sequence = _HEADER.unpack_from(data)
    if magic != MAGIC or content not in (FRAME, PACKET):
        raise WireError(f"datagram starts with {data[:2].hex()}: expected a frame or a packet")
    return content, sender_hw, sequence


class _Path(msgspec.Struct):
    misses: int = 0
    is_repeated: bool = False
    """The frame of the last datagram was retransmitted."""
    blocked_until_ns: int | None = None


class DatagramPaths:
    """Neighbours that lose datagrams: a firewall may pass beacons and connections, but not these."""

    def __init__(self) -> None:
        self._paths: dict[int, _Path] = {}

    def may_send(self, hw: int, now_ns: int) -> bool:
        """Whether a frame may go to this neighbour as a datagram."""
        path = self._paths.get(hw)
        if path is None or path.blocked_until_ns is None:
            return True
        if now_ns < path.blocked_until_ns:
            return False
        del self._paths[hw]
        return True

    def on_sent(self, hw: int) -> None:
        """Record that a frame is sent to the neighbour as a datagram."""
        path = self._paths.setdefault(hw, _Path())
        if not path.is_repeated:
            path.misses = 0  # the one before was answered in time
        path.is_repeated = False

    def on_repeated(self, hw: int, now_ns: int) -> None:
        """Record that an urgent frame is retransmitted to the neighbour, because no answer arrived."""
        path = self._paths.get(hw)
        if path is None or path.is_repeated:
            return
        path.is_repeated = True
        path.misses += 1
        if path.misses >= MISSES:
            path.blocked_until_ns = now_ns + RETRY_NS
