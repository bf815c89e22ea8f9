"""RTCP: the formats of RFC 3550, 4585 and 8888; truncated packets and other versions are refused."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.video.core import rtcp
from swarmd.video.core.rtcp import (
    Bye,
    KeyFrameRequest,
    PacketArrivals,
    ReceiverReport,
    SenderReport,
    decode,
    encode,
)
from swarmd.video.core.rtp_packet import is_rtcp
from swarmware.errors import WireError

MS = 1_000_000
SENT = SenderReport(7, 0xE000_0000_8000_0000, 90_000, 12, 3_456)
RECEIVED = ReceiverReport(8, 7, 0.25, -3, 0x1_0005, 90, 0x0000_8000, 6_553)
BYTES = {
    SENT: "80c80006 00000007 e0000000 80000000 00015f90 0000000c 00000d80",
    RECEIVED: "81c90007 00000008 00000007 40fffffd 00010005 0000005a 00008000 00001999",
    KeyFrameRequest(8, 7): "81ce0002 00000008 00000007",
    PacketArrivals(8, 7, 65_535, (0, None, 500 * MS)): "8bcd0006 00000008 00000007 ffff0003"
    " 80000000 82000000 00000000",
    Bye(7): "81cb0001 00000007",
}


@pytest.mark.parametrize("report", BYTES, ids=lambda one: type(one).__name__)
def test_each_report_has_the_layout_of_its_rfc(report: rtcp.Report) -> None:
    data = bytes.fromhex(BYTES[report])
    assert encode(report) == data
    assert is_rtcp(data)
    (found,) = decode(data)
    assert found == report


def test_compound_packet_skips_unknown_types_in_order() -> None:
    name = rtcp.description(7, "uav1")
    assert len(name) % 4 == 0
    unknown = bytes.fromhex("80d00001 00000007")
    assert decode(encode(SENT) + name + unknown + encode(Bye(7))) == [SENT, Bye(7)]


def test_a_sender_report_may_hold_blocks_of_reception() -> None:
    blocks = encode(RECEIVED)[8:]
    body = encode(SENT)[4:] + blocks
    data = bytes((0x81, 200)) + (len(body) // 4).to_bytes(2) + body
    assert decode(data) == [SENT, ReceiverReport(7, 7, 0.25, -3, 0x1_0005, 90, 0x8000, 6_553)]


def test_full_intra_request_asks_for_key_frame_too() -> None:
    assert decode(bytes.fromhex("84ce0004 00000008 00000007 00000007 01000000")) == [KeyFrameRequest(8, 7)]


def test_ntp_time_counts_from_1900_with_binary_fractions() -> None:
    assert rtcp.ntp_of(0) == 2_208_988_800 << 32
    assert rtcp.ntp_of(1_500_000_000) == 2_208_988_801 << 32 | 0x8000_0000


@pytest.mark.parametrize(
    "data",
    [
        "",
        "80c8",
        "80c80006 00000007",
        "41c90001 00000008",
        "81c90001 00000008",
        "80c80001 00000007",
        "8bcd0003 00000008 00000007 0000ffff",
        "8bcd0003 00000008 00000007 00000010",
        "80cb0000 00000000",
    ],
)
def test_truncated_or_foreign_version_is_refused(data: str) -> None:
    with pytest.raises(WireError):
        decode(bytes.fromhex(data))


@given(st.binary(max_size=80))
def test_garbage_is_reports_or_refused(data: bytes) -> None:
    with suppress(WireError):
        decode(data)
