"""A video session in virtual time: an encoder that keeps its rate, the two cores, and media between them."""

import random

import msgspec
from tests.simulation.reliable.radio_link import MS, Medium, S

from swarmd.video.config import Config
from swarmd.video.core.receiver import Decode, ReceiverAction, VideoReceiver
from swarmd.video.core.rtcp import decode
from swarmd.video.core.sender import (
    PATH_BYTES,
    EncodeKeyFrame,
    SenderAction,
    SendRtp,
    SetBitrate,
    VideoSender,
)
from swarmware.testing.virtual import VirtualTime
from swarmware.transport.delivery.bitrate_control import BitrateControl

PERIOD_NS = 40 * MS
TICKS = 3600
"""A picture at 25 Hz in units of 90 kHz."""


class Shown(msgspec.Struct, frozen=True):
    """One picture that was decoded."""

    at_ns: int
    index: int
    age_ns: int


class SimulatedSession:
    """A camera at 25 Hz, and its receiver."""

    def __init__(
        self,
        there: Medium,
        back: Medium,
        *,
        max_bit_s: int = 4_000_000,
        pinned: bool = False,
        reports_arrivals: bool = True,
        seed: int = 1,
    ) -> None:
        self.time = VirtualTime(S)
        self.there, self.back = there, back
        self.shown: list[Shown] = []
        self.rates: list[tuple[int, int]] = []
        """Rate of the encoder at each picture."""
        self._random = random.Random(seed)
        self._bit_s = max_bit_s
        self._debt = 0.0
        self._index = -1
        self._is_key_wanted = True
        bitrate = BitrateControl(max_bit_s, pinned, S)
        self.sender = VideoSender(
            Config(), 7, 65_000, 1000, bitrate, S, reports_arrivals=reports_arrivals, utc_less_clock_ns=0
        )
        self.receiver = VideoReceiver(Config(wait_s=0.04), 7, S)
        self._sending = self.time.drive(self.sender, self._on_sender)
        self._receiving = self.time.drive(self.receiver, self._on_receiver)
        self.time.every(PERIOD_NS / 1e9, self._camera)

    def run(self, until_s: float) -> None:
        """Run until an instant."""
        self.time.run_until(S + round(until_s * 1e9))

    def change(self, at_s: float, rate_bit_s: float) -> None:
        """The link has this rate from an instant on."""

        def set_rate() -> None:
            # what is in the queue now leaves it at the new rate
            now_ns, there = self.time.now_ns, self.there
            waiting = max(0, there.free_ns - now_ns) * there.rate_bit_s
            there.rate_bit_s = rate_bit_s
            there.free_ns = now_ns + round(waiting / rate_bit_s)

        self.time.at(S + round(at_s * 1e9), set_rate)

    def queueing_ms(self, begin_s: float = 0.0, end_s: float = 1e9) -> list[float]:
        """Queueing delays in the link in this span, sorted."""
        begin_ns, end_ns = S + begin_s * 1e9, S + end_s * 1e9
        return sorted(wait / MS for at, wait in self.there.queueing if begin_ns <= at < end_ns)

    def mean_bit_s(self, begin_s: float, end_s: float) -> float:
        """Rate of the encoder in this span."""
        found = [rate for at, rate in self.rates if begin_s <= (at - S) / 1e9 < end_s]
        return sum(found) / len(found)

    def _camera(self) -> None:
        self._index += 1
        now_ns = self.time.now_ns
        self._sending.feed(self.sender.on_timer(now_ns))
        self.rates.append((now_ns, self._bit_s))
        if not self.sender.may_encode(now_ns):
            return
        wanted = self._bit_s / 8 / 25
        is_key, self._is_key_wanted = self._is_key_wanted, False
        # a key frame is several times as large; the encoder saves the rest afterwards
        size = wanted * (4.0 if is_key else self._random.uniform(0.6, 1.4))
        if not is_key:
            saved = min(self._debt, size / 2)
            size -= saved
            self._debt -= saved
        else:
            self._debt += 3 * wanted
        unit = bytes((0x65 if is_key else 0x41,)) + self._index.to_bytes(4).replace(b"\0", b"\7")
        unit += now_ns.to_bytes(9).replace(b"\0", b"\7") + b"\x55" * max(0, int(size) - 14)
        stream = b"\0\0\0\1" + unit
        self._sending.feed(self.sender.on_picture(stream, self._index * TICKS, now_ns))

    def _on_sender(self, action: SenderAction) -> None:
        match action:
            case SendRtp(data):
                at_ns = self.there.arrival_ns(len(data) + PATH_BYTES, self.time.now_ns)
                if at_ns is not None:
                    self.time.at(at_ns, lambda: self._arrive(data))
            case SetBitrate(bit_s):
                self._bit_s = bit_s
            case EncodeKeyFrame():
                self._is_key_wanted = True

    def _arrive(self, data: bytes) -> None:
        self._receiving.feed(self.receiver.on_packet(data, self.time.now_ns))

    def _on_receiver(self, action: ReceiverAction) -> None:
        match action:
            case SendRtp(data):
                at_ns = self.back.arrival_ns(len(data) + PATH_BYTES, self.time.now_ns)
                if at_ns is not None:
                    self.time.at(at_ns, lambda: self._report(data))
            case Decode(unit):
                index = (unit.timestamp // TICKS) & 0xFFFF_FFFF
                age_ns = self.time.now_ns - (S + (index + 1) * PERIOD_NS)
                self.shown.append(Shown(self.time.now_ns, index, age_ns))

    def _report(self, data: bytes) -> None:
        now_ns = self.time.now_ns
        self._sending.feed(self.sender.on_rtcp(decode(data), now_ns))


def share(values: list[float], ratio: float) -> float:
    """The value below which this ratio of the sorted values is."""
    return values[min(len(values) - 1, int(ratio * len(values)))]
