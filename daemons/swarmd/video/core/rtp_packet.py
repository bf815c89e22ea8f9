"""RTP packets (RFC 3550, section 5.1), and their sequence numbers without wrap-around."""

import struct
from typing import Final

import msgspec

from swarmware.errors import WireError

VERSION: Final = 2
_HEADER: Final = struct.Struct("!BBHII")
HEADER_BYTES: Final = _HEADER.size
CLOCK_HZ: Final = 90_000
"""Clock of the timestamps of H.264 (RFC 6184, section 5.1)."""
PAYLOAD_TYPE: Final = 96
"""First dynamic payload type (RFC 3551, section 6)."""
_RTCP_TYPES: Final = range(192, 224)
"""Packet types of RTCP, in the byte where RTP has marker and payload type (RFC 5761, section 4)."""


class RtpPacket(msgspec.Struct, frozen=True):
    """One RTP packet, without padding, contributing sources and header extension."""

    sequence: int
    """Sequence number modulo 2¹⁶."""
    timestamp: int
    """Instant of the picture in units of 1/90 000 s, modulo 2³²."""
    ssrc: int
    payload: bytes
    marker: bool = False
    """True for the last packet of a picture."""
    payload_type: int = PAYLOAD_TYPE


def encode(packet: RtpPacket) -> bytes:
    """Encodes a packet with its header."""
    header = _HEADER.pack(
        VERSION << 6,
        packet.marker << 7 | packet.payload_type,
        packet.sequence & 0xFFFF,
        packet.timestamp & 0xFFFF_FFFF,
        packet.ssrc,
    )
    return header + packet.payload


def decode(data: bytes) -> RtpPacket:
    """Decodes a packet; padding, contributing sources and header extension are removed.

    Raises: WireError for anything but a packet of version 2 with a payload.
    """
    if len(data) < HEADER_BYTES:
        raise WireError(f"RTP packet of {len(data)} bytes: expected at least {HEADER_BYTES}")
    first, second, sequence, timestamp, ssrc = _HEADER.unpack_from(data)
    if first >> 6 != VERSION:
        raise WireError(f"RTP packet of version {first >> 6}: expected {VERSION}")
    # the low four bits count the contributing sources, of four bytes each
    start, end = HEADER_BYTES + 4 * (first & 0x0F), len(data)
    if first & 0x10:
        if end < start + 4:
            raise WireError("RTP packet: cut short in its header extension")
        start += 4 + 4 * int.from_bytes(data[start + 2 : start + 4])
    if first & 0x20:
        end -= data[-1] or len(data)  # the length includes its own byte, so 0 is invalid
    if end <= start:
        raise WireError(f"RTP packet of {len(data)} bytes: no payload")
    return RtpPacket(sequence, timestamp, ssrc, data[start:end], bool(second & 0x80), second & 0x7F)


def is_rtcp(data: bytes) -> bool:
    """True if a packet is RTCP, False if it is RTP."""
    return len(data) > 1 and data[1] in _RTCP_TYPES


class SequenceExtender:
    """Extends sequence numbers beyond 16 bits, to the number nearest to the highest number so far."""

    def __init__(self) -> None:
        self.highest: int | None = None

    def extend(self, sequence: int) -> int:
        """Extended number of an arrived packet, which may be the new highest one."""
        if self.highest is None:
            self.highest = (
                0x1_0000 + sequence
            )  # not 0, so that packets before the first one have positive numbers
            return self.highest
        number = self.nearest(sequence)
        self.highest = max(self.highest, number)
        return number

    def nearest(self, sequence: int) -> int:
        """Extended number of a sequence number, nearest to the highest number."""
        highest = self.highest or 0
        step = (sequence - highest) & 0xFFFF
        return highest + (step if step < 0x8000 else step - 0x1_0000)
