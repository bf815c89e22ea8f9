"""The sending end: paced packets within a window, reaction to reports, and a limited wait."""

from swarmd.video.config import Config
from swarmd.video.core import rtcp, rtp_packet
from swarmd.video.core.rtcp import Bye, KeyFrameRequest, PacketArrivals, ReceiverReport, SenderReport
from swarmd.video.core.rtp_packet import RtpPacket
from swarmd.video.core.sender import (
    DISCARD_NS,
    GUARD_S,
    HOLD_NS,
    PATH_BYTES,
    RTP_BYTES,
    EncodeKeyFrame,
    EndSession,
    SenderAction,
    SendRtp,
    SetBitrate,
    VideoSender,
)
from swarmware.transport.delivery.bitrate_control import BitrateControl

MS = 1_000_000
S = 1_000_000_000
UTC_NS = 1_700_000_000 * S


def sender(*, reports_arrivals: bool = True, pinned: bool = False, guard_bit_s: float = 0.0) -> VideoSender:
    return VideoSender(
        Config(guard_bit_s=guard_bit_s),
        7,
        65_530,
        1000,
        BitrateControl(1_000_000, pinned, 0),
        0,
        reports_arrivals=reports_arrivals,
        utc_less_clock_ns=UTC_NS,
    )


def picture(size: int) -> bytes:
    return b"\0\0\0\1\x65" + b"x" * (size - 1)


def packets(actions: list[SenderAction]) -> list[RtpPacket]:
    data = [one.data for one in actions if isinstance(one, SendRtp) and not rtp_packet.is_rtcp(one.data)]
    return [rtp_packet.decode(one) for one in data]


def drained(core: VideoSender, until_ns: int) -> list[tuple[int, RtpPacket]]:
    """Packets that the timers send up to an instant, and when."""
    found: list[tuple[int, RtpPacket]] = []
    while (at_ns := core.deadline_ns()) is not None and at_ns <= until_ns:
        found += [(at_ns, one) for one in packets(core.on_timer(at_ns))]
    return found


def test_pictures_number_past_wrap_and_mark_end() -> None:
    core = sender()
    sent = packets(core.on_picture(picture(9_000), 4_242, 0))
    sent += [one for _, one in drained(core, 900 * MS)]
    assert [one.sequence for one in sent] == [(65_530 + index) & 0xFFFF for index in range(10)]
    assert {one.timestamp for one in sent} == {4_242}
    assert [one.marker for one in sent] == [False] * 9 + [True]


def test_packets_leave_at_pace_and_not_beyond_window() -> None:
    core = sender()
    first = len(packets(core.on_picture(picture(40_000), 0, 0)))
    assert 3 <= first <= 6
    later = drained(core, 900 * MS)
    assert 10 <= first + len(later) < 14, "the window of a new link"
    assert core.waiting_ns(900 * MS) == 900 * MS
    begin = later[0][1].sequence - first
    heard = PacketArrivals(6, 7, begin & 0xFFFF, (0,) * (first + len(later)))
    assert packets(core.on_rtcp([heard], 901 * MS)), "what has arrived makes room"


def test_standard_receiver_needs_no_report_for_next_packets() -> None:
    core = sender(reports_arrivals=False)
    sent = packets(core.on_picture(picture(40_000), 0, 0)) + [one for _, one in drained(core, 500 * MS)]
    assert sent[-1].marker
    # 2.5 times the rate of the encoder: 40 kB at 1 Mbit/s take 128 ms
    assert core.waiting_ns(500 * MS) == 0


def test_pictures_are_skipped_while_packets_wait() -> None:
    core = sender()
    core.on_picture(picture(60_000), 0, 0)
    assert core.may_encode(HOLD_NS)
    assert not core.may_encode(HOLD_NS + 1)
    assert core.counters.skipped == 1
    actions = core.on_timer(DISCARD_NS)
    assert EncodeKeyFrame() in actions
    assert core.counters.discarded > 40
    assert core.may_encode(DISCARD_NS)


def test_undecoding_receiver_gets_key_frame_until_end() -> None:
    core = sender()
    assert core.on_rtcp([KeyFrameRequest(6, 7)], 0) == [EncodeKeyFrame()]
    assert core.on_rtcp([Bye(6)], 0) == [EndSession()]


def test_reports_of_other_sources_and_garbage_are_counted() -> None:
    core = sender()
    others: list[rtcp.Report] = [
        KeyFrameRequest(6, 8),
        PacketArrivals(6, 8, 0, (0,)),
        ReceiverReport(6, 8, 0, 0, 0, 0, 0, 0),
    ]
    assert core.on_rtcp([*others, SenderReport(6, 0, 0, 0, 0)], 0) == []
    core.count_garbage()
    assert core.counters.refused == 5


def test_overtaken_packets_are_lost_until_arrival() -> None:
    core = sender()
    core.on_picture(picture(5_000), 0, 0)
    drained(core, 500 * MS)
    ages = (0, None, 0, 0, 0, 0)
    core.on_rtcp([PacketArrivals(6, 7, 65_530, ages)], 510 * MS)
    assert core.counters.lost == 1
    core.on_rtcp([PacketArrivals(6, 7, 65_530, (0, 0, 0, 0, 0, 0))], 520 * MS)
    assert core.counters.lost == 0


def test_age_of_arrival_is_not_round_trip() -> None:
    core = sender()
    core.on_picture(picture(500), 0, 0)
    core.on_rtcp([PacketArrivals(6, 7, 65_530, (30 * MS,))], 50 * MS)
    assert core.round_trip_ns == 20 * MS


def test_standard_receiver_reports_loss_and_round_trip() -> None:
    core = sender(reports_arrivals=False)
    ntp = rtcp.ntp_of(UTC_NS + 1 * S) >> 16 & 0xFFFF_FFFF
    report = ReceiverReport(6, 7, 0.3, 12, 0, 0, ntp, 65_536 // 2)
    actions = core.on_rtcp([report], 1 * S + 520 * MS)
    assert core.counters.lost == 12
    assert core.round_trip_ns is not None
    assert abs(core.round_trip_ns - 20 * MS) < MS
    assert actions == [SetBitrate(850_000)]


def test_silence_of_receiver_frees_window_and_lowers_rate() -> None:
    core = sender()
    core.on_picture(picture(60_000), 0, 0)
    drained(core, 900 * MS)
    actions = core.on_timer(1 * S)
    assert SetBitrate(500_000) in actions
    assert packets(core.on_picture(picture(2_000), 90_000, 1 * S))


def test_an_operator_pins_the_rate_at_once() -> None:
    core = sender()
    assert core.on_pin(300_000, True, 0) == [SetBitrate(300_000)]
    core.on_timer(1 * S)
    core.on_timer(2 * S)
    assert core.bitrate.bit_s == 300_000


def test_sender_report_maps_timestamp_to_utc_once_second() -> None:
    core = sender()
    core.on_picture(picture(500), 90_000, 0)
    reports = [one for one in core.on_timer(1 * S) if isinstance(one, SendRtp)]
    found = rtcp.decode(reports[0].data)
    assert found == [SenderReport(7, rtcp.ntp_of(UTC_NS + 1 * S), 180_000, 1, 500)]


def test_traffic_in_flight_fits_guarded_rate() -> None:
    core = sender(guard_bit_s=200_000.0)
    first = packets(core.on_picture(picture(40_000), 0, 0))
    first += [one for _, one in drained(core, 900 * MS)]
    assert 0.12 < sum(len(one.payload) + RTP_BYTES + PATH_BYTES for one in first) * 8 / 200_000 <= GUARD_S
    assert packets(core.on_timer(901 * MS)) == []
    arrived = PacketArrivals(8, 7, first[0].sequence, (MS, MS))
    assert len(packets(core.on_rtcp([arrived], 902 * MS))) == 2, "each arrival makes room for one"


def test_packet_that_is_larger_than_guard_leaves_alone() -> None:
    core = sender(guard_bit_s=1000.0)
    assert len(packets(core.on_picture(picture(9_000), 0, 0))) == 1
