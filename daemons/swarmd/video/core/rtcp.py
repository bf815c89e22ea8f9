"""RTCP: sender and receiver reports (RFC 3550), key frame requests (RFC 4585), arrival times (RFC 8888)."""

import struct
from typing import Final

import msgspec

from swarmware.errors import WireError

SENDER_REPORT: Final = 200
RECEIVER_REPORT: Final = 201
DESCRIPTION: Final = 202
BYE: Final = 203
TRANSPORT_FEEDBACK: Final = 205
PAYLOAD_FEEDBACK: Final = 206
_PICTURE_LOSS: Final = 1
"""Format of PAYLOAD_FEEDBACK: the receiver needs a key frame (RFC 4585, section 6.3.1)."""
_FULL_INTRA: Final = 4
"""Format of PAYLOAD_FEEDBACK: the receiver requests a key frame (RFC 5104, section 4.3.1)."""
_ARRIVALS: Final = 11
"""Format of TRANSPORT_FEEDBACK (RFC 8888, section 3.1)."""
_HEAD: Final = struct.Struct("!BBH")
_BLOCK: Final = struct.Struct("!IIIIII")
_SENDER: Final = struct.Struct("!IIIII")
_ARRIVED: Final = 0x8000
_OFFSET_MAX: Final = 0x1FFD
"""Maximum arrival offset, in 1/1024 s (RFC 8888, section 3.1)."""
ARRIVALS_MAX: Final = 512
NTP_EPOCH_S: Final = 2_208_988_800
"""Seconds from the NTP epoch 1900 to the Unix epoch 1970 (RFC 5905, figure 4)."""


class SenderReport(msgspec.Struct, frozen=True):
    """Totals of a sender, and the mapping of its timestamps to NTP time."""

    ssrc: int
    ntp: int
    """NTP time in a 32.32 bit fixed-point format."""
    timestamp: int
    packets: int
    octets: int


class ReceiverReport(msgspec.Struct, frozen=True):
    """Reception of one source, as its receiver reports it."""

    ssrc: int
    """SSRC of the receiver."""
    source: int
    lost_ratio: float
    """Loss ratio since the last report."""
    lost: int
    """Number of lost packets since the beginning."""
    highest: int
    """Highest received sequence number, extended by the count of wrap-arounds."""
    jitter: int
    """Interarrival jitter in units of timestamps."""
    last_report: int
    """Middle 32 bits of the NTP time of the last sender report, or 0 without one."""
    delay: int
    """Delay since the last sender report, in 1/65536 s."""


class KeyFrameRequest(msgspec.Struct, frozen=True):
    """Request of a receiver that cannot decode before the next key frame."""

    ssrc: int
    source: int


class PacketArrivals(msgspec.Struct, frozen=True):
    """Arrivals of a range of packets."""

    ssrc: int
    source: int
    begin: int
    """Sequence number of the first packet."""
    ages_ns: tuple[int | None, ...]
    """Time from the arrival of each packet to this report, or None for a missing packet."""


class Bye(msgspec.Struct, frozen=True):
    """Notice that the sender of this packet ends the session."""

    ssrc: int


Report = SenderReport | ReceiverReport | KeyFrameRequest | PacketArrivals | Bye


def ntp_of(utc_ns: int) -> int:
    """Converts a UTC instant to NTP time in a 32.32 bit fixed-point format."""
    seconds, rest_ns = divmod(utc_ns, 1_000_000_000)
    return (seconds + NTP_EPOCH_S & 0xFFFF_FFFF) << 32 | (rest_ns << 32) // 1_000_000_000


def encode(report: Report) -> bytes:
    """Encodes one report as an RTCP packet."""
    match report:
        case SenderReport():
            body = report.ssrc.to_bytes(4) + _SENDER.pack(
                report.ntp >> 32,
                report.ntp & 0xFFFF_FFFF,
                report.timestamp & 0xFFFF_FFFF,
                report.packets & 0xFFFF_FFFF,
                report.octets & 0xFFFF_FFFF,
            )
            return _packet(0, SENDER_REPORT, body)
        case ReceiverReport():
            lost = max(-0x80_0000, min(report.lost, 0x7F_FFFF)) & 0xFF_FFFF
            block = _BLOCK.pack(
                report.source,
                # a fixed-point fraction of 8 bits, so a loss of all packets is 255
                min(255, int(report.lost_ratio * 256)) << 24 | lost,
                report.highest & 0xFFFF_FFFF,
                min(report.jitter, 0xFFFF_FFFF),
                report.last_report,
                min(report.delay, 0xFFFF_FFFF),
            )
            return _packet(1, RECEIVER_REPORT, report.ssrc.to_bytes(4) + block)
        case KeyFrameRequest():
            body = report.ssrc.to_bytes(4) + report.source.to_bytes(4)
            return _packet(_PICTURE_LOSS, PAYLOAD_FEEDBACK, body)
        case PacketArrivals():
            return _encode_arrivals(report)
        case Bye():
            return _packet(1, BYE, report.ssrc.to_bytes(4))


def description(ssrc: int, name: str) -> bytes:
    """Source description with the canonical name, which accompanies every report (RFC 3550, section 6.1)."""
    text = name.encode()[:255]
    chunk = ssrc.to_bytes(4) + bytes((1, len(text))) + text
    return _packet(1, DESCRIPTION, chunk + bytes(4 - len(chunk) % 4))


def _packet(count: int, kind: int, body: bytes) -> bytes:
    return _HEAD.pack(0x80 | count, kind, len(body) // 4) + body


def _encode_arrivals(report: PacketArrivals) -> bytes:
    words = [
        0 if age_ns is None else _ARRIVED | min(age_ns * 1024 // 1_000_000_000, _OFFSET_MAX)
        for age_ns in report.ages_ns
    ]
    counted = len(words)
    # the arrivals are padded to whole words of 32 bits
    if counted % 2:
        words.append(0)
    body = struct.pack(
        f"!IIHH{len(words)}HI", report.ssrc, report.source, report.begin & 0xFFFF, counted, *words, 0
    )
    return _packet(_ARRIVALS, TRANSPORT_FEEDBACK, body)


def decode(data: bytes) -> list[Report]:
    """Decodes the reports of a compound packet; other types of RTCP packets are skipped.

    Raises: WireError for anything but a sequence of RTCP packets.
    """
    reports: list[Report] = []
    at = 0
    while at < len(data):
        if len(data) - at < 8:
            raise WireError(f"RTCP packet of {len(data) - at} bytes: expected at least 8")
        first, kind, length = _HEAD.unpack_from(data, at)
        end = at + 4 + 4 * length
        # every type begins with the number of its sender, so a length of 0 is invalid
        if first >> 6 != 2 or end > len(data) or not length:
            raise WireError(f"RTCP packet at byte {at}: of another version, or cut short")
        reports += _decoded(first & 0x1F, kind, data[at + 4 : end])
        at = end
    if not data:
        raise WireError("RTCP: empty")
    return reports


def _decoded(count: int, kind: int, body: bytes) -> list[Report]:
    try:
        ssrc = int.from_bytes(body[:4])
        if kind == SENDER_REPORT:
            high, low, timestamp, packets, octets = _SENDER.unpack_from(body, 4)
            sent = SenderReport(ssrc, high << 32 | low, timestamp, packets, octets)
            return [sent, *_blocks(ssrc, count, body, 4 + _SENDER.size)]
        if kind == RECEIVER_REPORT:
            return list(_blocks(ssrc, count, body, 4))
        if kind == PAYLOAD_FEEDBACK and count in (_PICTURE_LOSS, _FULL_INTRA) and len(body) >= 8:
            return [KeyFrameRequest(ssrc, int.from_bytes(body[4:8]))]
        if kind == TRANSPORT_FEEDBACK and count == _ARRIVALS:
            return [_arrivals(ssrc, body)]
        if kind == BYE:
            return [Bye(ssrc)]
    except struct.error as error:
        raise WireError(f"RTCP packet of type {kind}: cut short") from error
    return []


def _blocks(ssrc: int, count: int, body: bytes, at: int) -> list[ReceiverReport]:
    found = []
    for index in range(count):
        source, loss, highest, jitter, last, delay = _BLOCK.unpack_from(body, at + index * _BLOCK.size)
        lost = loss & 0xFF_FFFF
        # a signed number of 24 bits; duplicates make it negative
        lost -= 0x100_0000 if lost & 0x80_0000 else 0
        found.append(ReceiverReport(ssrc, source, (loss >> 24) / 256, lost, highest, jitter, last, delay))
    return found


def _arrivals(ssrc: int, body: bytes) -> PacketArrivals:
    source, begin, count = struct.unpack_from("!IHH", body, 4)
    if count > ARRIVALS_MAX:
        raise WireError(f"RTCP: arrivals of {count} packets: expected at most {ARRIVALS_MAX}")
    words = struct.unpack_from(f"!{count}H", body, 12)
    ages = tuple((word & 0x1FFF) * 1_000_000_000 // 1024 if word & _ARRIVED else None for word in words)
    return PacketArrivals(ssrc, source, begin, ages)
