"""Frames as datagrams: selection, packing, and the clear header."""

import struct
import zlib
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.frame import HOPS_AT, Codec, Flag, Frame, FrameKind, encode, encoded_bytes
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
_REPEATED: Final = frozenset({FrameKind.MESSAGE, FrameKind.REQUEST, FrameKind.ACK, FrameKind.REPLY})
SEQUENCE_MAX: Final = 0xFFFF_FFFF
MISSES: Final = 2
"""Consecutive datagrams with retransmitted frames after which the path counts as blocked."""
RETRY_NS: Final = 60_000_000_000
"""Period after which a neighbour gets datagrams again."""
BURST: Final = 32
BURST_NS: Final = 10_000_000
"""Datagrams to one neighbour within this time that are not urgent; further frames take the connection, which
waits for a receiver that is slower. The kernel's buffer of the receiver has room for about 250."""


def may_begin(frame: Frame) -> bool:
    """Whether the first transmission of a frame may be a datagram: it is urgent, or a small message, request
    or answer, whose sender repeats what is lost."""
    if frame.is_urgent:
        return True
    return frame.kind in _REPEATED and len(frame.payload) <= FRAME_MAX and not frame.is_bulk


def pack(frame: Frame, data: bytes | None = None) -> bytes | None:
    """The encoded frame if it is small enough for a datagram, an urgent one compressed if necessary; a signed
    frame stays as it is. `data`: the frame as it was encoded; its hops may have changed since."""
    limit = COMPRESS_MAX if frame.is_urgent else FRAME_MAX
    if len(frame.payload) > limit:
        return None
    if data is None or data[HOPS_AT] != frame.hops_left:
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
    burst: int = 0
    """Datagrams since `burst_ns`."""
    burst_ns: int = 0


class DatagramPaths:
    """Neighbours that lose datagrams: a firewall may pass beacons and connections, but not these."""

    def __init__(self, burst: int | None = None) -> None:
        """`burst`: limit of datagrams to a neighbour within `BURST_NS`, or None if unlimited."""
        self._burst = burst
        self._paths: dict[int, _Path] = {}

    def may_send(self, hw: int, now_ns: int) -> bool:
        """Whether a frame may go to this neighbour as a datagram."""
        path = self._paths.get(hw)
        if path is None:
            return True
        if path.blocked_until_ns is None:
            return self._burst is None or path.burst < self._burst or now_ns - path.burst_ns >= BURST_NS
        if now_ns < path.blocked_until_ns:
            return False
        del self._paths[hw]
        return True

    def on_sent(self, hw: int, now_ns: int) -> None:
        """Record that a frame is sent to the neighbour as a datagram."""
        path = self._paths.get(hw)
        if path is None:
            path = self._paths[hw] = _Path()
        if now_ns - path.burst_ns >= BURST_NS:
            path.burst, path.burst_ns = 0, now_ns
        path.burst += 1
        if not path.is_repeated:
            path.misses = 0  # the one before was answered in time
        path.is_repeated = False

    def on_repeated(self, hw: int, now_ns: int) -> None:
        """Record that a frame is retransmitted to the neighbour, because no answer arrived."""
        path = self._paths.get(hw)
        if path is None or path.is_repeated:
            return
        path.is_repeated = True
        path.misses += 1
        if path.misses >= MISSES:
            path.blocked_until_ns = now_ns + RETRY_NS
