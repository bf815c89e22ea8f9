"""The receiving end: pictures in order, key frames after gaps, and timely reports."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.video.config import Config
from swarmd.video.core import rtcp, rtp_packet
from swarmd.video.core.h264_payload import AccessUnit, packetize
from swarmd.video.core.receiver import (
    ARRIVALS_EVERY,
    ARRIVALS_NS,
    KEY_FRAME_NS,
    Decode,
    ReceiverAction,
    VideoReceiver,
    receiver_ssrc,
)
from swarmd.video.core.rtcp import Bye, KeyFrameRequest, PacketArrivals, ReceiverReport, SenderReport
from swarmd.video.core.rtp_packet import RtpPacket
from swarmd.video.core.sender import EndSession, SendRtp

MS = 1_000_000
S = 1_000_000_000
SOURCE = 7
WAIT_NS = 40 * MS


def receiver() -> VideoReceiver:
    return VideoReceiver(Config(wait_s=WAIT_NS / 1e9), SOURCE, 0)


def picture(index: int, first: int, *, key: bool = False, size: int = 250) -> list[bytes]:
    """The packets of one picture, numbered from `first`."""
    unit = (b"\x65" if key else b"\x41") + bytes((index + 1,)) * size
    payloads = packetize([unit], 102)
    return [
        rtp_packet.encode(RtpPacket(first + at, index * 3600, SOURCE, one, at == len(payloads) - 1))
        for at, one in enumerate(payloads)
    ]


def fed(core: VideoReceiver, packets: list[bytes], at_ns: int = 0) -> list[ReceiverAction]:
    return [action for one in packets for action in core.on_packet(one, at_ns)]


def decoded(actions: list[ReceiverAction]) -> list[int]:
    return [one.unit.timestamp // 3600 for one in actions if isinstance(one, Decode)]


def reports(actions: list[ReceiverAction]) -> list[rtcp.Report]:
    return [found for one in actions if isinstance(one, SendRtp) for found in rtcp.decode(one.data)]


def test_pictures_arrive_in_order_despite_packets() -> None:
    core = receiver()
    first, second, third = picture(0, 10, key=True), picture(1, 13), picture(2, 16)
    actions = fed(core, [*first, second[1], second[0], third[0], second[2], third[2], third[1]])
    assert decoded(actions) == [0, 1, 2]
    assert (core.counters.lost, core.counters.gaps, core.counters.dropped) == (0, 0, 0)


def test_nothing_is_shown_before_requested_key_frame() -> None:
    core = receiver()
    actions = fed(core, picture(0, 10))
    assert decoded(actions) == []
    assert KeyFrameRequest(receiver_ssrc(SOURCE), SOURCE) in reports(actions)
    assert decoded(fed(core, picture(1, 13, key=True))) == [1]
    assert core.counters.dropped == 1


def test_gap_requests_key_frame_until_it_comes() -> None:
    core = receiver()
    fed(core, picture(0, 10, key=True))
    assert decoded(fed(core, picture(1, 13)[1:], MS)) == []
    asked_ns = core.deadline_ns()
    assert asked_ns == MS + WAIT_NS
    key_frame = KeyFrameRequest(receiver_ssrc(SOURCE), SOURCE)
    assert key_frame in reports(core.on_timer(MS + WAIT_NS))
    assert (core.counters.lost, core.counters.gaps, core.counters.dropped) == (1, 1, 1)
    later_ns = MS + WAIT_NS + KEY_FRAME_NS
    assert key_frame not in reports(fed(core, picture(2, 16), later_ns - 1))
    assert key_frame in reports(core.on_timer(later_ns))
    assert decoded(fed(core, picture(3, 19, key=True), later_ns + MS)) == [3]
    assert decoded(fed(core, picture(4, 22), later_ns + MS)) == [4]
    assert core.counters.key_frames_asked == 3


def test_arrivals_are_reported_by_count_or_time() -> None:
    core = receiver()
    packets = picture(0, 10, key=True, size=100 * ARRIVALS_EVERY) + picture(1, 10 + ARRIVALS_EVERY)
    early = [
        one for one in reports(fed(core, packets[:ARRIVALS_EVERY], 5 * MS)) if isinstance(one, PacketArrivals)
    ]
    assert [(one.begin, len(one.ages_ns)) for one in early] == [(10, ARRIVALS_EVERY)]
    core.on_packet(packets[ARRIVALS_EVERY + 1], 20 * MS)
    due_ns = 20 * MS + ARRIVALS_NS
    (late,) = [one for one in reports(core.on_timer(due_ns)) if isinstance(one, PacketArrivals)]
    assert late.begin == 10, "reports overlap: one may be lost"
    assert late.ages_ns[ARRIVALS_EVERY] is None
    age_ns = late.ages_ns[ARRIVALS_EVERY + 1]
    assert age_ns is not None
    assert abs(age_ns - ARRIVALS_NS) < MS


def test_receiver_report_has_loss_jitter_and_sender() -> None:
    core = receiver()
    first = picture(0, 10, key=True)
    sent = SenderReport(SOURCE, 0x1234_5678_9ABC_DEF0, 0, 3, 300)
    core.on_packet(rtcp.encode(sent), 0)
    fed(core, [first[0], first[2]], 100 * MS)
    found = [one for one in reports(core.on_timer(S)) if isinstance(one, ReceiverReport)]
    assert len(found) == 1
    report = found[0]
    assert (report.source, report.lost, report.highest) == (SOURCE, 1, 12)
    assert report.lost_ratio == pytest.approx(1 / 3, abs=0.01)
    assert (report.last_report, report.delay) == (0x5678_9ABC, 65_536)


def test_the_jitter_is_that_of_rfc_3550() -> None:
    core = receiver()
    # the second picture comes 10 ms later than its timestamp says: 900 ticks, of which a sixteenth counts
    fed(core, picture(0, 10, key=True, size=50), 0)
    fed(core, picture(1, 11, size=50), 50 * MS)
    assert core.jitter == pytest.approx(900 / 16)


def test_picture_refused_by_decoder_needs_key_frame() -> None:
    core = receiver()
    fed(core, picture(0, 10, key=True))
    actions = core.on_undecodable(MS)
    assert KeyFrameRequest(receiver_ssrc(SOURCE), SOURCE) in reports(actions)
    assert decoded(fed(core, picture(1, 13), MS)) == []


def test_foreign_or_damaged_packet_is_refused_and_counted() -> None:
    core = receiver()
    other = rtp_packet.encode(RtpPacket(10, 0, SOURCE + 1, b"\x65"))
    another_type = rtp_packet.encode(RtpPacket(10, 0, SOURCE, b"\x65", payload_type=97))
    damaged = rtp_packet.encode(RtpPacket(10, 0, SOURCE, b"\x1f"))
    foreign = rtcp.encode(SenderReport(SOURCE + 1, 0, 0, 0, 0))
    for data in (b"", b"garbage", other, another_type, foreign):
        assert core.on_packet(data, 0) == []
    assert core.counters.refused == 5
    core.on_packet(damaged, 0)
    assert core.counters.refused == 6


def test_the_end_of_the_sender_ends_the_session() -> None:
    core = receiver()
    assert core.on_packet(rtcp.encode(Bye(SOURCE)), 0) == [EndSession()]
    assert core.on_packet(rtcp.encode(Bye(SOURCE + 2)), 0) == []


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_garbage_never_becomes_a_picture(datagrams: list[bytes]) -> None:
    core = receiver()
    for at, data in enumerate(datagrams):
        head = rtp_packet.encode(RtpPacket(at, 0, SOURCE, data or b"\xff"))
        for one in (data, head):
            for action in core.on_packet(one, at * MS):
                assert not isinstance(action, Decode) or action.unit.is_key
    core.on_timer(core.deadline_ns() or 0)


def test_a_picture_is_one_access_unit() -> None:
    core = receiver()
    (action,) = [one for one in fed(core, picture(0, 10, key=True)) if isinstance(one, Decode)]
    assert action.unit == AccessUnit(0, (b"\x65" + b"\x01" * 250,))
