"""The receiving end of a session: turns RTP packets into pictures in order, and reports to the sender."""

from collections import deque
from typing import Final

import msgspec

from swarmd.video.config import Config
from swarmd.video.core import rtcp, rtp_packet
from swarmd.video.core.h264_payload import AccessUnit, Depacketizer
from swarmd.video.core.jitter_buffer import JitterBuffer, OrderedPacket
from swarmd.video.core.rtcp import Bye, KeyFrameRequest, PacketArrivals, ReceiverReport, SenderReport
from swarmd.video.core.rtp_packet import CLOCK_HZ, SequenceExtender
from swarmd.video.core.sender import EndSession, SendRtp
from swarmd.video.core.session_counters import SessionCounters
from swarmware.errors import WireError

ARRIVALS_EVERY: Final = 3
"""Number of packets after which their arrivals are reported."""
ARRIVALS_NS: Final = 50_000_000
"""Maximum time from an arrival to its report (RFC 8888, section 3.2: 50 ms to 200 ms)."""
REPORT_NS: Final = 1_000_000_000
KEY_FRAME_NS: Final = 300_000_000
"""Minimum time between two requests for a key frame."""
OVERLAP: Final = 64
"""Number of packets that are reported again, because a report may be lost."""
KEPT: Final = 512
SECOND_NS: Final = 1_000_000_000


class Decode(msgspec.Struct, frozen=True):
    """Action: decode a picture; no picture is missing since the last key frame."""

    unit: AccessUnit


ReceiverAction = SendRtp | Decode | EndSession


class ReceiverCounters(SessionCounters):
    """Counters of the receiving end."""

    gaps: int = 0
    dropped: int = 0
    """Pictures that were damaged, or depend on a lost picture."""


def receiver_ssrc(source: int) -> int:
    """SSRC of the receiver of a source, which both ends derive from the source's number."""
    return source ^ 1


class VideoReceiver:
    """Reception of one source of RTP."""

    def __init__(self, config: Config, source: int, now_ns: int) -> None:
        """`source`: SSRC of the sender."""
        self.counters = ReceiverCounters()
        self.buffer = JitterBuffer(round(config.wait_s * 1e9))
        self.jitter = 0.0
        """Interarrival jitter in units of timestamps (RFC 3550, appendix A.8)."""
        self._received_ns = now_ns
        self._silence_ns = round(config.silence_s * 1e9)
        self._ssrc = receiver_ssrc(source)
        self._source = source
        self._extender = SequenceExtender()
        self._depacketizer = Depacketizer()
        self._waits_for_key = True
        self._key_asked_ns: int | None = None
        self._transit: float | None = None
        self._arrived: dict[int, int] = {}
        self._recent: deque[int] = deque()
        self._unreported = 0
        self._first_unreported_ns: int | None = None
        self._report_ns = now_ns + REPORT_NS
        self._before = (0, 0)
        """Expected and received packets at the last report."""
        self._first: int | None = None
        self._sender_report: tuple[int, int] | None = None
        """Middle 32 bits of the NTP time of the last sender report, and the arrival of the report."""

    def is_silent(self, now_ns: int) -> bool:
        """True if no packet has arrived for the silence time."""
        return now_ns - self._received_ns > self._silence_ns

    def on_packet(self, data: bytes, now_ns: int) -> list[ReceiverAction]:
        """Takes an RTP or RTCP packet of the sender; other packets are refused and counted."""
        try:
            if rtp_packet.is_rtcp(data):
                return self._on_rtcp(rtcp.decode(data), now_ns)
            packet = rtp_packet.decode(data)
        except WireError:
            self.counters.refused += 1
            return []
        # packets of an earlier session may still be on their way
        if packet.ssrc != self._source or packet.payload_type != rtp_packet.PAYLOAD_TYPE:
            self.counters.refused += 1
            return []
        self._received_ns = now_ns
        number = self._extender.extend(packet.sequence)
        self.counters.packets += 1
        self.counters.octets += len(data)
        self._first = number if self._first is None else min(self._first, number)
        self._on_transit(packet.timestamp, now_ns)
        self._on_arrival(number, now_ns)
        ordered = self.buffer.put(number, packet, now_ns)
        return [*self._pictures(ordered, now_ns), *self._due_reports(now_ns)]

    def on_timer(self, now_ns: int) -> list[ReceiverAction]:
        """Ends the wait for missing packets, and sends due reports."""
        return [*self._pictures(self.buffer.on_due(now_ns), now_ns), *self._due_reports(now_ns)]

    def deadline_ns(self) -> int | None:
        """Instant of the next call of `on_timer`."""
        instants = [self._report_ns, self.buffer.deadline_ns()]
        if self._first_unreported_ns is not None:
            instants.append(self._first_unreported_ns + ARRIVALS_NS)
        if self._waits_for_key and self._key_asked_ns is not None:
            instants.append(self._key_asked_ns + KEY_FRAME_NS)
        return min(one for one in instants if one is not None)

    def _pictures(self, ordered: list[OrderedPacket], now_ns: int) -> list[ReceiverAction]:
        actions: list[ReceiverAction] = []
        for item in ordered:
            if item.lost:
                self.counters.lost += item.lost
                self.counters.gaps += 1
                # further pictures refer to the lost one, so decoding waits for a key frame
                self._depacketizer.on_gap()
                self._waits_for_key = True
            packet = item.packet
            try:
                units = self._depacketizer.on_payload(packet.payload, packet.timestamp, packet.marker)
            except WireError:
                self.counters.refused += 1
                self._waits_for_key = True
                continue
            for unit in units:
                if unit.is_key:
                    self._waits_for_key, self._key_asked_ns = False, None
                if self._waits_for_key:
                    self.counters.dropped += 1
                else:
                    self.counters.pictures += 1
                    actions.append(Decode(unit))
        self.counters.dropped += self._depacketizer.damaged
        self._depacketizer.damaged = 0
        return actions

    def on_undecodable(self, now_ns: int) -> list[ReceiverAction]:
        """Takes that the decoder has refused a picture, and requests a key frame."""
        self.counters.dropped += 1
        self._waits_for_key = True
        return self._due_reports(now_ns)

    def _on_rtcp(self, reports: list[rtcp.Report], now_ns: int) -> list[ReceiverAction]:
        actions: list[ReceiverAction] = []
        for report in reports:
            match report:
                case SenderReport(ssrc=self._source):
                    self._sender_report = (report.ntp >> 16 & 0xFFFF_FFFF, now_ns)
                    self._received_ns = now_ns
                case Bye(ssrc=self._source):
                    actions.append(EndSession())
                case _:
                    self.counters.refused += 1
        return actions

    def _on_transit(self, timestamp: int, now_ns: int) -> None:
        transit = now_ns * CLOCK_HZ / SECOND_NS - timestamp
        if self._transit is not None:
            step = abs(transit - self._transit)
            if step < CLOCK_HZ:  # a larger step is a wrap-around of the timestamp
                self.jitter += (step - self.jitter) / 16
        self._transit = transit

    def _on_arrival(self, number: int, now_ns: int) -> None:
        if number not in self._arrived:
            self._recent.append(number)
        self._arrived[number] = now_ns
        # bounds the memory of arrivals
        while len(self._recent) > KEPT:
            del self._arrived[self._recent.popleft()]
        self._unreported += 1
        if self._first_unreported_ns is None:
            self._first_unreported_ns = now_ns

    def _due_reports(self, now_ns: int) -> list[ReceiverAction]:
        actions: list[ReceiverAction] = []
        if self._waits_for_key and self.counters.packets:
            asked_ns = self._key_asked_ns
            if asked_ns is None or now_ns - asked_ns >= KEY_FRAME_NS:
                self._key_asked_ns = now_ns
                self.counters.key_frames_asked += 1
                actions.append(SendRtp(rtcp.encode(KeyFrameRequest(self._ssrc, self._source))))
        since_ns = self._first_unreported_ns
        if since_ns is not None and (self._unreported >= ARRIVALS_EVERY or now_ns - since_ns >= ARRIVALS_NS):
            actions.append(SendRtp(rtcp.encode(self._arrivals(now_ns))))
        if now_ns >= self._report_ns:
            self._report_ns = now_ns + REPORT_NS
            if self.counters.packets:
                actions.append(SendRtp(rtcp.encode(self._report(now_ns))))
        return actions

    def _arrivals(self, now_ns: int) -> PacketArrivals:
        highest = self._extender.highest or 0
        begin = max(min(self._recent), highest - OVERLAP - self._unreported, highest + 1 - rtcp.ARRIVALS_MAX)
        self._unreported, self._first_unreported_ns = 0, None
        ages = tuple(
            now_ns - self._arrived[number] if number in self._arrived else None
            for number in range(begin, highest + 1)
        )
        return PacketArrivals(self._ssrc, self._source, begin & 0xFFFF, ages)

    def _report(self, now_ns: int) -> ReceiverReport:
        highest, counters = self._extender.highest or 0, self.counters
        expected = highest - (self._first or 0) + 1
        # duplicates would hide losses
        received = counters.packets - self.buffer.duplicates
        span = (expected - self._before[0], received - self._before[1])
        self._before = (expected, received)
        lost_ratio = max(0.0, 1 - span[1] / span[0]) if span[0] > 0 else 0.0
        last, delay = 0, 0
        if self._sender_report is not None:
            last, arrived_ns = self._sender_report
            delay = (now_ns - arrived_ns << 16) // SECOND_NS
        return ReceiverReport(
            self._ssrc,
            self._source,
            lost_ratio,
            expected - received,
            highest & 0xFFFF | (highest - 0x1_0000 & 0xFFFF_0000),
            int(self.jitter),
            last,
            delay,
        )
