"""A session that this node receives, whose packets become images in a stream."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import msgspec

from swarmd.video.codec import H264Decoder
from swarmd.video.config import Config
from swarmd.video.core import rtcp
from swarmd.video.core.receiver import Decode, ReceiverAction, VideoReceiver, receiver_ssrc
from swarmd.video.core.rtp_packet import CLOCK_HZ
from swarmd.video.core.sender import SendRtp
from swarmware.errors import WireError
from swarmware.model.names import Address
from swarmware.module.module import Module
from swarmware.module.streamwriter import StreamWriter
from swarmware.runtime.driver import CoreDriver
from swarmware.types.perception import Image
from swarmware.types.video import VideoDirection, VideoSession

SLOTS: Final = 8
"""Number of images that stay readable; an image of 640 x 272 has half a megabyte."""
SLOT_BYTES: Final = 256 * 1024
WAITING_MAX: Final = 64
"""Maximum number of pictures that wait for a decoder that is too slow."""


class ReceivingSession:
    """Receives the video of one source of another platform."""

    def __init__(
        self,
        module: Module,
        number: int,
        sender: Address,
        source: str,
        *,
        config: Config,
        send: Callable[[bytes], None],
    ) -> None:
        """`send`: sends a report to the sender. Raises: NotFound without PyAV, Conflict."""
        now_ns = module.now_ns()
        self.number = number
        """SSRC of the sender's RTP packets."""
        self.sender = sender
        self.source = source
        self.has_ended = False
        """True once the sender has ended the session."""
        self._module = module
        self._send = send
        self._started_ns = now_ns
        self._decoder = H264Decoder()
        self._writer: StreamWriter[Image] = module.stream_writer(
            f"video/{sender.platform}/{source}",
            Image,
            slots=SLOTS,
            slot_bytes=SLOT_BYTES,
            link="request",
            description=f"Video of /{sender.platform}/{source}",
        )
        self._executor = ThreadPoolExecutor(1, "video-decoder")
        self._queue: asyncio.Queue[Decode] = asyncio.Queue(WAITING_MAX)
        self._is_closed = False
        self._core = VideoReceiver(config, number, now_ns)
        self._driver: CoreDriver[ReceiverAction] = CoreDriver(
            self._core, self._perform, name="video", clock=module.clock, loop=asyncio.get_running_loop()
        )

    @property
    def path(self) -> str:
        """Local path of the stream of images."""
        return self._writer.path

    async def run(self) -> None:
        """Decodes pictures until cancelled."""
        loop = asyncio.get_running_loop()
        self._driver.feed()
        try:
            while True:
                decode = await self._queue.get()
                try:
                    images = await loop.run_in_executor(
                        self._executor, self._decoder.decode, decode.unit.stream
                    )
                except WireError:
                    self._driver.feed(self._core.on_undecodable(self._module.now_ns()))
                    continue
                for image in images:
                    self._writer.write(image)
        finally:
            self.close()

    def close(self) -> None:
        """Ends the session, and notifies the sender."""
        if self._is_closed:
            return
        self._is_closed = True
        # a Bye to a sender that has ended would answer its Bye
        if not self.has_ended:
            self._send(rtcp.encode(rtcp.Bye(receiver_ssrc(self.number))))
        self._driver.stop()
        self._module.close_writer(self._writer)
        # the event loop must not wait for a picture that is being decoded
        self._executor.shutdown(wait=False)

    def on_packet(self, data: bytes) -> None:
        """Takes a packet of the sender."""
        self._driver.feed(self._core.on_packet(data, self._module.now_ns()))

    def is_silent(self, now_ns: int) -> bool:
        """True if no packet has arrived for the silence time."""
        return self._core.is_silent(now_ns)

    def _perform(self, action: ReceiverAction) -> None:
        match action:
            case SendRtp(data):
                self._send(data)
            case Decode() if not self._queue.full():
                self._queue.put_nowait(action)
            case Decode():
                # dropped: the next pictures depend on this one, so a key frame is requested
                self._driver.defer(self._core.on_undecodable(self._module.now_ns()))
            case _:
                self.has_ended = True

    def report(self) -> VideoSession:
        """Report of the session, with its counters."""
        core, counters = self._core, self._core.counters
        direction, other = VideoDirection.RECEIVED, str(self.sender)
        return msgspec.structs.replace(
            counters.report(self.number, direction, self.source, other, self.path, self._started_ns),
            gaps=counters.gaps,
            dropped=counters.dropped,
            refused=counters.refused + core.buffer.late + core.buffer.duplicates,
            jitter_s=core.jitter / CLOCK_HZ,
        )
