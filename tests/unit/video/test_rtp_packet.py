"""RTP packets: format, refused packets, and sequence numbers beyond 16 bits."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.video.core.rtp_packet import RtpPacket, SequenceExtender, decode, encode, is_rtcp
from swarmware.errors import WireError

PACKET = RtpPacket(0x1234, 0x0102_0304, 0xCAFE_BABE, b"\x65payload", marker=True)
ENCODED = bytes.fromhex("80e0 1234 01020304 cafebabe") + b"\x65payload"


def test_a_packet_has_the_header_of_rfc_3550() -> None:
    assert encode(PACKET) == ENCODED
    assert decode(ENCODED) == PACKET
    assert not is_rtcp(ENCODED)


def test_mixer_sources_extension_and_padding_are_removed() -> None:
    data = bytes.fromhex("b2e0 1234 01020304 cafebabe 00000001 00000002 bede0001 aabbccdd")
    assert decode(data + b"\x65payload" + b"\0\0\x03") == PACKET


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "of 0 bytes"),
        (ENCODED[:11], "of 11 bytes"),
        (ENCODED[:12], "no payload"),
        (b"\x40" + ENCODED[1:], "of version 1"),
        (b"\x8f" + ENCODED[1:], "no payload"),
        (b"\x90" + ENCODED[1:14], "header extension"),
        (b"\xa0" + ENCODED[1:-1] + b"\x00", "no payload"),
        (b"\xa0" + ENCODED[1:-1] + b"\xff", "no payload"),
    ],
)
def test_anything_else_is_refused_with_its_reason(data: bytes, reason: str) -> None:
    with pytest.raises(WireError, match=reason):
        decode(data)


@given(st.binary(max_size=64))
def test_garbage_is_a_packet_or_refused(data: bytes) -> None:
    with suppress(WireError):
        assert decode(data).payload


@pytest.mark.parametrize(
    ("arrived", "numbers"),
    [
        ([5, 6, 8, 7], [0, 1, 3, 2]),
        ([65534, 65535, 0, 1], [0, 1, 2, 3]),
        ([0, 65535, 1], [0, -1, 1]),
        ([65535, 1, 0], [0, 2, 1]),
    ],
)
def test_sequence_numbers_go_on_beyond_16_bits(arrived: list[int], numbers: list[int]) -> None:
    extender = SequenceExtender()
    found = [extender.extend(one) for one in arrived]
    assert [one - found[0] for one in found] == numbers
    assert [one & 0xFFFF for one in found] == arrived
