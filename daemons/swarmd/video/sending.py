"""A session that this node sends, with its source, its encoder, and the path of its packets."""

import asyncio
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final, NamedTuple

import msgspec

from swarmd.video.codec import H264Encoder, to_frame
from swarmd.video.config import Config
from swarmd.video.core import rtcp
from swarmd.video.core.destination import Destination
from swarmd.video.core.rtp_packet import CLOCK_HZ
from swarmd.video.core.sender import (
    EncodeKeyFrame,
    EndSession,
    SenderAction,
    SendRtp,
    SetBitrate,
    VideoSender,
)
from swarmd.video.rtp_socket import RtpSocket, SwarmPath
from swarmd.video.sources import PictureSource
from swarmware.errors import WireError
from swarmware.model.clock import utc_ns
from swarmware.module.module import Module
from swarmware.runtime.driver import CoreDriver
from swarmware.transport.delivery.bitrate_control import BitrateControl
from swarmware.types.perception import Image
from swarmware.types.video import VideoDirection, VideoRateChange, VideoSession, VideoStart

PAYLOAD_MAX: Final = 1000
"""Maximum payload after the RTP header, which fits in one datagram with the headers of ten hops."""


KEY_FRAME_S: Final = 10.0
"""Key-frame interval of a session to a platform, which can also request a key frame."""
KEY_FRAME_BLIND_S: Final = 2.0
"""Key-frame interval for standard receivers, which may join late and cannot request key frames."""


class Receiver(NamedTuple):
    """Receiver of a session, and the path of the packets to it."""

    destination: Destination
    path: SwarmPath | RtpSocket
    described: str = ""
    """Session description (SDP), or empty for a platform."""
    received_as: str = ""
    """Stream of the images at the receiving platform, or empty for an address."""
    hardware: int | None = None
    """Hardware id of the receiving computer, or None for an address."""


class SendingSession:
    """Sends the video of one source to one receiver."""

    def __init__(
        self,
        module: Module,
        config: Config,
        number: int,
        request: VideoStart,
        receiver: Receiver,
        *,
        source: PictureSource,
        executor: ThreadPoolExecutor,
        max_hz: float | None,
    ) -> None:
        """`max_hz`: maximum pictures a second, or None for all."""
        destination, max_bit_s = receiver.destination, request.max_bit_s
        now_ns = module.now_ns()
        self.number = number
        """SSRC of the session's RTP packets."""
        self.name = request.source
        self.destination = destination
        self.receiver_hw = receiver.hardware
        self.has_ended = False
        """True once the receiver has ended the session."""
        self._module = module
        self._source = source
        self._executor = executor
        self._path = receiver.path
        self._described = receiver.described
        self._received_as = receiver.received_as
        self._started_ns = now_ns
        bitrate = BitrateControl(max_bit_s, request.pinned, now_ns)
        # random, as RFC 3550 requires (section 5.1)
        sequence = int.from_bytes(os.urandom(2))
        self._core = VideoSender(
            config,
            number,
            sequence,
            PAYLOAD_MAX,
            bitrate,
            now_ns,
            reports_arrivals=bool(destination.platform),
            utc_less_clock_ns=utc_ns() - now_ns,
        )
        self._period_ns = 0 if max_hz is None else round(1e9 / max_hz)
        self._due_ns = now_ns
        """Instant before which pictures are skipped, to keep to `max_hz`."""
        self._encoder = H264Encoder(
            config.encoder,
            source.rate_hz if max_hz is None else min(source.rate_hz, max_hz),
            bitrate.bit_s,
            max_bit_s,
            KEY_FRAME_S if destination.platform else KEY_FRAME_BLIND_S,
        )
        self._is_key_wanted = True
        self._is_closed = False
        self._driver: CoreDriver[SenderAction] = CoreDriver(
            self._core, self._perform, name="video", clock=module.clock, loop=asyncio.get_running_loop()
        )

    async def run(self) -> None:
        """Sends until cancelled. Raises: InvalidInput when the source ends."""
        loop, module = asyncio.get_running_loop(), self._module
        self._driver.feed()
        try:
            while True:
                picture = await self._source.next()
                now_ns = module.now_ns()
                # skipped before the encoder: a picture that was encoded cannot be left out
                if now_ns < self._due_ns or not self._core.may_encode(now_ns):
                    continue
                # absolute, so that jitter does not lower the rate; at most one period is caught up after a
                # pause
                self._due_ns = max(self._due_ns + self._period_ns, now_ns - self._period_ns)
                timestamp = now_ns * CLOCK_HZ // 1_000_000_000
                # cleared before the encoding, during which a new request may come
                key, self._is_key_wanted = self._is_key_wanted, False
                data = await loop.run_in_executor(self._executor, self._encoded, picture, timestamp, key)
                if data:
                    self._driver.feed(self._core.on_picture(data, timestamp, module.now_ns()))
        finally:
            self.close()

    def close(self) -> None:
        """Ends the session, and notifies the receiver."""
        if self._is_closed:
            return
        self._is_closed = True
        self._path.send(rtcp.encode(rtcp.Bye(self._core.ssrc)))
        self._driver.stop()
        self._path.close()
        self._source.close()
        self._executor.shutdown(wait=False)

    def _encoded(self, picture: Any, timestamp: int, key: bool) -> bytes:
        frame = to_frame(picture) if isinstance(picture, Image) else picture
        return self._encoder.encode(frame, timestamp, key=key)

    def on_packet(self, data: bytes) -> None:
        """Takes a packet of the receiver."""
        try:
            reports = rtcp.decode(data)
        except WireError:
            self._core.count_garbage()
            return
        self._driver.feed(self._core.on_rtcp(reports, self._module.now_ns()))

    def is_silent(self, now_ns: int) -> bool:
        """True if the receiver has been silent for too long."""
        return self._core.is_silent(now_ns)

    def pin(self, bit_s: int, pinned: bool) -> None:
        """Sets the highest rate, or the rate itself if `pinned`."""
        self._driver.feed(self._core.on_pin(bit_s, pinned, self._module.now_ns()))

    def _perform(self, action: SenderAction) -> None:
        match action:
            case SendRtp(data):
                self._path.send(data)
            case SetBitrate(bit_s):
                self._encoder.set_bitrate(bit_s)
            case EncodeKeyFrame():
                self._is_key_wanted = True
            case EndSession():
                self.has_ended = True

    def report(self) -> VideoSession:
        """Report of the session, with its counters."""
        core, counters, now_ns = self._core, self._core.counters, self._module.now_ns()
        bitrate, round_trip_ns = core.bitrate, core.round_trip_ns
        direction, other = VideoDirection.SENT, str(self.destination)
        return msgspec.structs.replace(
            counters.report(self.number, direction, self.name, other, self._received_as, self._started_ns),
            bit_s=bitrate.bit_s,
            max_bit_s=bitrate.max_bit_s,
            pinned=bitrate.pinned,
            skipped=counters.skipped,
            dropped=counters.discarded,
            queueing_s=core.queueing_ns / 1e9,
            waiting_s=core.waiting_ns(now_ns) / 1e9,
            round_trip_s=None if round_trip_ns is None else round_trip_ns / 1e9,
            changes=tuple(VideoRateChange(one.at_ns, one.bit_s, one.reason) for one in bitrate.changes),
            sdp=self._described,
        )
