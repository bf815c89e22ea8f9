"""H.264 by PyAV: pixels and JPEG files into a byte stream, and a byte stream into pixels."""

from fractions import Fraction
from types import ModuleType
from typing import Any, Final

from swarmd.video.core.rtp_packet import CLOCK_HZ
from swarmware.errors import InvalidInput, NotFound, WireError
from swarmware.types.perception import Image, ImageEncoding

_FORMATS: Final = {ImageEncoding.MONO8: ("gray", 1), ImageEncoding.RGB8: ("rgb24", 3)}
_SOFTWARE: Final = {"preset": "ultrafast", "tune": "zerolatency"}
"""No picture waits for a later one."""
BUFFER_S: Final = 0.2
"""Of video at the highest rate: what a key frame may exceed it by."""
SIZE_MAX: Final = 8192


def pyav() -> ModuleType:
    """The module of PyAV. Raises: NotFound where it is not installed."""
    try:
        import av
    except ImportError:
        raise NotFound("video needs PyAV: pip install 'swarmware[video]'") from None
    return av


class H264Encoder:
    """One encoder; it starts again when the size of the pictures changes."""

    def __init__(self, encoder: str, rate_hz: float, bit_s: int, max_bit_s: int, key_frame_s: float) -> None:
        """`bit_s`: first rate, `max_bit_s`: highest; `key_frame_s`: a key frame at least this often."""
        self._av = pyav()
        self._name = encoder
        self._rate_hz = rate_hz
        self._bit_s = bit_s
        self._max_bit_s = max_bit_s
        self._key_frame_s = key_frame_s
        self._context: Any = None

    def set_bitrate(self, bit_s: int) -> None:
        """Use another rate from the next picture on."""
        self._bit_s = bit_s
        if bit_s > self._max_bit_s:
            self._max_bit_s, self._context = bit_s, None  # the limit is fixed when it is opened
        elif self._context is not None:
            self._context.bit_rate = bit_s

    def encode(self, frame: Any, timestamp: int, *, key: bool) -> bytes:
        """The byte stream of one picture, a frame of PyAV; empty: the encoder keeps it.

        Units: the timestamp in 1/90 000 s. Raises: InvalidInput for a picture that cannot be encoded.
        """
        width, height = frame.width & ~1, frame.height & ~1
        try:
            if self._context is None or (self._context.width, self._context.height) != (width, height):
                self._context = self._opened(width, height)
            frame = frame.reformat(width=width, height=height, format=self._context.pix_fmt)
            kinds = self._av.video.frame.PictureType
            frame.pts, frame.time_base = timestamp, Fraction(1, CLOCK_HZ)
            frame.pict_type = kinds.I if key else kinds.NONE
            return b"".join(bytes(packet) for packet in self._context.encode(frame))
        except (ValueError, self._av.FFmpegError) as error:
            raise InvalidInput(f"encoder {self._name}: picture of {width}x{height}: {error}") from error

    def _opened(self, width: int, height: int) -> Any:
        context = self._av.CodecContext.create(self._name, "w")
        context.width, context.height, context.pix_fmt = width, height, "yuv420p"
        context.time_base = Fraction(1, CLOCK_HZ)
        context.framerate = Fraction(self._rate_hz).limit_denominator(1001)
        context.bit_rate = self._bit_s
        context.gop_size = max(1, round(self._rate_hz * self._key_frame_s))
        context.max_b_frames = 0
        context.thread_count = 1  # several threads make several slices, and wait for each other
        if self._name == "libx264":
            # x264 follows another rate only where it keeps to a buffer of the receiver (VBV), too
            buffer_bits = int(self._max_bit_s * BUFFER_S)
            context.options = {
                **_SOFTWARE,
                "maxrate": str(self._max_bit_s),
                "bufsize": str(buffer_bits),
            }
        return context


class H264Decoder:
    """Decodes one stream of H.264."""

    def __init__(self) -> None:
        self._av = pyav()
        self._context: Any = self._av.CodecContext.create("h264", "r")
        self._context.thread_count = 1
        self._context.flags |= 1 << 19  # AV_CODEC_FLAG_LOW_DELAY: no picture is kept back

    def decode(self, stream: bytes) -> list[Image]:
        """The pictures that a byte stream completes. Raises: WireError for a damaged one."""
        try:
            frames = self._context.decode(self._av.Packet(stream))
            return [to_image(frame) for frame in frames]
        except self._av.FFmpegError as error:
            raise WireError(f"H.264 of {len(stream)} bytes: {error}") from error


def to_image(frame: Any) -> Image:
    """A frame of PyAV as pixels."""
    plane = frame.reformat(format="rgb24").planes[0]
    data, row = bytes(plane), frame.width * 3
    if plane.line_size != row:
        data = b"".join(
            data[at : at + row] for at in range(0, plane.line_size * frame.height, plane.line_size)
        )
    return Image(frame.width, frame.height, ImageEncoding.RGB8, data)


def to_frame(image: Image) -> Any:
    """An image as a frame of PyAV. Raises: InvalidInput for a damaged one."""
    av = pyav()
    if image.encoding == ImageEncoding.JPEG:
        try:
            return av.CodecContext.create("mjpeg", "r").decode(av.Packet(image.data))[0]
        except (IndexError, av.FFmpegError) as error:
            raise InvalidInput(f"JPEG of {len(image.data)} bytes: {error}") from error
    known = _FORMATS.get(image.encoding)
    if known is None:
        raise InvalidInput(f"image of encoding {image.encoding}: expected mono8, rgb8 or jpeg")
    name, pixel_bytes = known
    row = image.width * pixel_bytes
    if not row or len(image.data) != row * image.height or max(image.width, image.height) > SIZE_MAX:
        raise InvalidInput(
            f"image of {image.width}x{image.height} {image.encoding} with {len(image.data)} bytes"
        )
    frame = av.VideoFrame(image.width, image.height, name)
    plane = frame.planes[0]
    data, padding = image.data, bytes(plane.line_size - row)
    if padding:
        data = b"".join(data[at : at + row] + padding for at in range(0, len(data), row))
    plane.update(data)
    return frame
