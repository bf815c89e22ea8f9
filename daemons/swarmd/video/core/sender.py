"""The sending end of a session: paces pictures as RTP packets, and sets the encoder's rate by the reports."""

from collections import deque
from typing import Final

import msgspec

from swarmd.video.config import Config
from swarmd.video.core import rtcp, rtp_packet
from swarmd.video.core.h264_payload import nal_units, packetize
from swarmd.video.core.rtcp import Bye, KeyFrameRequest, PacketArrivals, ReceiverReport, SenderReport
from swarmd.video.core.rtp_packet import RtpPacket
from swarmd.video.core.session_counters import SessionCounters
from swarmware.transport.delivery.bitrate_control import BitrateControl
from swarmware.transport.retransmission.rate_control import RateControl

REPORT_NS: Final = 1_000_000_000
"""Period of sender reports, from which receivers make the round trip measurable."""
REORDERED: Final = 3
"""Number of packets that overtake a packet before it counts as lost (RFC 9002, section 6.1.1)."""
SILENCE_NS: Final = 1_000_000_000
"""Time without an arrival after which all packets in flight count as lost."""
HOLD_NS: Final = 100_000_000
"""Age of the oldest waiting packet above which pictures are skipped, so that the queue can drain."""
DISCARD_NS: Final = 1_000_000_000
"""Age at which waiting packets are discarded as outdated, and a key frame is sent instead."""
PATH_BYTES: Final = 150
"""Size of the headers of a packet below RTP: frame, seal, UDP and IP."""
GUARD_S: Final = 0.17
"""Queue, in seconds, of the data in flight in a link that falls to the guarded rate. Packets that count as
lost but are still on their way add to the queue, up to about 0.2 s."""
RTP_BYTES: Final = 12
ROUND_TRIP_MIN_NS: Final = 10_000_000


class SendRtp(msgspec.Struct, frozen=True):
    """Action: send an RTP or RTCP packet to the other end."""

    data: bytes


class SetBitrate(msgspec.Struct, frozen=True):
    """Action: set the rate of the encoder."""

    bit_s: int


class EncodeKeyFrame(msgspec.Struct, frozen=True):
    """Action: encode the next picture as a key frame."""


class EndSession(msgspec.Struct, frozen=True):
    """Action: end the session, as the other end has done."""


SenderAction = SendRtp | SetBitrate | EncodeKeyFrame | EndSession


class SenderCounters(SessionCounters):
    """Counters of the sending end, whose `refused` counts reports."""

    skipped: int = 0
    """Number of pictures that were not encoded, because packets were waiting."""
    discarded: int = 0
    """Number of packets that were discarded after too long a wait."""


class VideoSender:
    """Sends the packets of one RTP source, and controls its rate."""

    def __init__(
        self,
        config: Config,
        ssrc: int,
        first_sequence: int,
        payload_max: int,
        bitrate: BitrateControl,
        now_ns: int,
        *,
        reports_arrivals: bool,
        utc_less_clock_ns: int,
    ) -> None:
        """`ssrc` and `first_sequence`: random numbers; `payload_max`: bytes after the RTP header.

        `reports_arrivals`: the receiver reports the arrival of each packet, so that a window can be kept;
        `utc_less_clock_ns`: UTC minus the clock of `now_ns`, for sender reports.
        """
        self.ssrc = ssrc
        self.bitrate = bitrate
        self.window = RateControl(now_ns)
        self.counters = SenderCounters()
        self.round_trip_ns: int | None = None
        self.reported_ns: int | None = None
        """Instant of the receiver's last report."""
        self._arrived_ns = now_ns
        """Instant of the last report with a new arrival."""
        self._reports_arrivals = reports_arrivals
        self._payload_max = payload_max
        self._sequence = first_sequence
        self._waiting: deque[tuple[RtpPacket, int]] = deque()
        """Packets before the link, with the instants at which they were made."""
        self._in_flight: dict[int, tuple[int, int]] = {}
        """Size and send instant of unacknowledged packets, by sequence number modulo 2¹⁶."""
        self._lost: dict[int, int] = {}
        """Sizes of packets that count as lost, kept to detect a late arrival."""
        self._paced_until_ns: int | None = None
        self._report_ns = now_ns
        self._timestamp = (0, now_ns)
        self._asked_bit_s = bitrate.bit_s
        self._utc_less_clock_ns = utc_less_clock_ns
        self._silence_ns = round(config.silence_s * 1e9)
        self._began_ns = now_ns
        self._guard_bytes = int(config.guard_bit_s * GUARD_S / 8)
        """Maximum number of bytes in flight, however fast the link is, or 0 for no limit."""

    @property
    def queueing_ns(self) -> int:
        """Measured queueing delay in the link."""
        return self.window.delay.queueing_ns

    def waiting_ns(self, now_ns: int) -> int:
        """Age of the oldest packet that waits before the link, or 0 if none waits."""
        return now_ns - self._waiting[0][1] if self._waiting else 0

    def is_silent(self, now_ns: int) -> bool:
        """True if a receiver that must report has been silent for too long."""
        return self._reports_arrivals and now_ns - (self.reported_ns or self._began_ns) > self._silence_ns

    def may_encode(self, now_ns: int) -> bool:
        """True if the next picture is to be encoded; otherwise counts it as skipped."""
        if self.waiting_ns(now_ns) <= HOLD_NS:
            return True
        self.counters.skipped += 1
        return False

    def on_picture(self, stream: bytes, timestamp: int, now_ns: int) -> list[SenderAction]:
        """Takes an encoded picture, a byte stream of NAL units, and sends its packets."""
        payloads = packetize(nal_units(stream), self._payload_max)
        for index, payload in enumerate(payloads):
            marker = index == len(payloads) - 1
            packet = RtpPacket(self._sequence, timestamp & 0xFFFF_FFFF, self.ssrc, payload, marker)
            self._waiting.append((packet, now_ns))
            self._sequence = (self._sequence + 1) & 0xFFFF
        self._timestamp = (timestamp & 0xFFFF_FFFF, now_ns)
        self.counters.pictures += 1
        return self._send(now_ns)

    def on_pin(self, bit_s: int, pinned: bool, now_ns: int) -> list[SenderAction]:
        """Takes the rate that an operator sets."""
        self.bitrate.pin(bit_s, pinned, now_ns)
        return self._asked(change_min=0.0)

    def on_rtcp(self, reports: list[rtcp.Report], now_ns: int) -> list[SenderAction]:
        """Takes the reports of the receiver."""
        actions: list[SenderAction] = []
        for report in reports:
            match report:
                case KeyFrameRequest(source=self.ssrc):
                    self.counters.key_frames_asked += 1
                    actions.append(EncodeKeyFrame())
                case ReceiverReport(source=self.ssrc):
                    self.reported_ns = now_ns
                    self._on_report(report, now_ns)
                case PacketArrivals(source=self.ssrc):
                    self.reported_ns = now_ns
                    self._on_arrivals(report, now_ns)
                case Bye():
                    actions.append(EndSession())
                case _:
                    self.counters.refused += 1
        return [*actions, *self._asked(), *self._send(now_ns)]

    def count_garbage(self) -> None:
        """Counts a packet of the receiver that was not RTCP."""
        self.counters.refused += 1

    def on_timer(self, now_ns: int) -> list[SenderAction]:
        """Sends the packets that the pace allows and the sender report, and discards outdated packets."""
        actions: list[SenderAction] = []
        if self.waiting_ns(now_ns) >= DISCARD_NS:
            self.counters.discarded += len(self._waiting)
            self._waiting.clear()
            self._paced_until_ns = None
            actions.append(EncodeKeyFrame())
        if now_ns >= self._report_ns:
            self._report_ns = now_ns + REPORT_NS
            actions.append(SendRtp(self._report(now_ns)))
            self._on_silence(now_ns)
        return [*actions, *self._asked(), *self._send(now_ns)]

    def deadline_ns(self) -> int | None:
        """Instant of the next call of `on_timer`."""
        instants = [self._report_ns]
        if self._paced_until_ns is not None:
            instants.append(self._paced_until_ns)
        if self._waiting:
            instants.append(self._waiting[0][1] + DISCARD_NS)
        return min(instants)

    def _send(self, now_ns: int) -> list[SenderAction]:
        actions: list[SenderAction] = []
        self._paced_until_ns = None
        while self._waiting:
            if self._reports_arrivals and not self.window.has_room(reserve=False):
                self.window.on_limited()
                break  # until reports free the window, or a silence resets it
            if self._reports_arrivals and self._exceeds_guard(len(self._waiting[0][0].payload)):
                break
            wait_ns = self._wait_ns(now_ns)
            if wait_ns:
                self._paced_until_ns = now_ns + wait_ns
                break
            packet, _ = self._waiting.popleft()
            data = rtp_packet.encode(packet)
            size = len(data) + PATH_BYTES
            self.window.on_sent(size)
            if self._reports_arrivals:
                self._in_flight[packet.sequence] = (size, now_ns)
            self.counters.packets += 1
            self.counters.octets += len(packet.payload)
            actions.append(SendRtp(data))
        return actions

    def _exceeds_guard(self, payload_bytes: int) -> bool:
        """True if another packet would wait too long in a link that falls to the guarded rate now."""
        in_flight = self.window.in_flight
        size = payload_bytes + RTP_BYTES + PATH_BYTES
        return bool(self._guard_bytes and in_flight) and in_flight + size > self._guard_bytes

    def _wait_ns(self, now_ns: int) -> int:
        """Pause before the next packet, so that a picture does not fill the link's queue at once."""
        round_trip_ns = max(self.round_trip_ns or 0, ROUND_TRIP_MIN_NS)
        if self._reports_arrivals:
            return self.window.wait_ns(round_trip_ns, now_ns)
        # without reports of arrivals the window is spread over the time in which the encoder fills it, halved
        return self.window.wait_ns(int(self.window.window * 8e9 / (2.0 * self.bitrate.bit_s)), now_ns)

    def _on_report(self, report: ReceiverReport, now_ns: int) -> None:
        round_trip_ns = None
        if report.last_report:
            middle = rtcp.ntp_of(now_ns + self._utc_less_clock_ns) >> 16 & 0xFFFF_FFFF
            ticks = (middle - report.last_report - report.delay) & 0xFFFF_FFFF
            # a larger difference is a negative one, from clocks that disagree
            if ticks < 0x8000_0000:
                round_trip_ns = ticks * 1_000_000_000 >> 16
        if self._reports_arrivals:
            return  # the reports of arrivals are more precise
        self.counters.lost = max(report.lost, 0)
        self.round_trip_ns = round_trip_ns if round_trip_ns is not None else self.round_trip_ns
        self.bitrate.on_report(report.lost_ratio, round_trip_ns, now_ns)

    def _on_arrivals(self, report: PacketArrivals, now_ns: int) -> None:
        if not self._reports_arrivals:
            return
        window, arrived = self.window, -1
        for index, age_ns in enumerate(report.ages_ns):
            if age_ns is None:
                continue
            arrived = index
            sequence = (report.begin + index) & 0xFFFF
            # a packet that was only late makes the reduction of the window unjustified
            if self._lost.pop(sequence, None) is not None:
                window.on_spurious()
                self.counters.lost -= 1
                continue
            sent = self._in_flight.pop(sequence, None)
            if sent is None:
                continue
            self._arrived_ns = now_ns
            size, sent_ns = sent
            window.on_acknowledged(size)
            self.bitrate.on_received(size, now_ns)
            # without the time for which the receiver held the report
            round_trip_ns = max(now_ns - sent_ns - age_ns, 1)
            window.on_round_trip(round_trip_ns, now_ns)
            before_ns = self.round_trip_ns or round_trip_ns
            self.round_trip_ns = (7 * before_ns + round_trip_ns) // 8
        self._on_lost_before((report.begin + arrived - REORDERED) & 0xFFFF if arrived >= 0 else None)
        window.on_round(max(self.round_trip_ns or 0, ROUND_TRIP_MIN_NS), now_ns)
        self.bitrate.on_queue(self.queueing_ns, self.waiting_ns(now_ns), now_ns)

    def _on_lost_before(self, sequence: int | None) -> None:
        """Counts all packets in flight up to this sequence number as lost."""
        if sequence is None:
            return
        gone = [one for one in self._in_flight if (sequence - one) & 0xFFFF < 0x8000]
        for one in gone:
            size, _ = self._in_flight.pop(one)
            self.window.on_lost(size)
            self.counters.lost += 1
            self._lost[one] = size
        while len(self._lost) > 1024:
            # evicts the oldest packet, which is the least likely to arrive
            del self._lost[next(iter(self._lost))]

    def _on_silence(self, now_ns: int) -> None:
        # judged by arrivals, because a receiver behind a one-way link still reports that nothing arrives
        if not self._in_flight or now_ns - self._arrived_ns < SILENCE_NS:
            return
        for size, _ in self._in_flight.values():
            self.window.on_lost(size)
        self._in_flight.clear()
        self.window.on_silence()
        self.bitrate.on_silence(now_ns)

    def _report(self, now_ns: int) -> bytes:
        timestamp, made_ns = self._timestamp
        timestamp += (now_ns - made_ns) * rtp_packet.CLOCK_HZ // 1_000_000_000
        ntp = rtcp.ntp_of(now_ns + self._utc_less_clock_ns)
        counters = self.counters
        sent = SenderReport(self.ssrc, ntp, timestamp, counters.packets, counters.octets)
        return rtcp.encode(sent) + rtcp.description(self.ssrc, f"swarm-{self.ssrc:08x}")

    def _asked(self, change_min: float = 0.03) -> list[SenderAction]:
        """Sets the encoder's rate if it has changed by more than the ratio `change_min`."""
        bit_s = self.bitrate.bit_s
        if abs(bit_s - self._asked_bit_s) <= change_min * self._asked_bit_s:
            return []
        self._asked_bit_s = bit_s
        return [SetBitrate(bit_s)]
