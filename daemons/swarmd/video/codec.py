"""H.264 with PyAV: encodes pixels and JPEG files to a byte stream, and decodes a byte stream to pixels."""

from fractions import Fraction
from types import ModuleType
from typing import Any, Final

from swarmd.video.core.rtp_packet import CLOCK_HZ
from swarmware.errors import InvalidInput, NotFound, WireError
from swarmware.types.perception import Image, ImageEncoding

_FORMATS: Final = {ImageEncoding.MONO8: ("gray", 1), ImageEncoding.RGB8: ("rgb24", 3)}
_SOFTWARE: Final = {"preset": "ultrafast", "tune": "zerolatency"}
"""Options of libx264 for the lowest delay, without pictures that wait for later ones."""
BUFFER_S: Final = 0.2
"""Size of the encoder's rate buffer (VBV) in seconds of video, by which a key frame may exceed the rate."""
SIZE_MAX: Final = 8192


def pyav() -> ModuleType:
    """Imports PyAV. Raises: NotFound where it is not installed."""
    try:
        import av
    except ImportError:
        raise NotFound("video needs PyAV: pip install 'swarmware[video]'") from None
    return av


class H264Encoder:
    """Encoder of one stream of H.264, which is opened again when the size of the pictures changes."""

    def __init__(self, encoder: str, rate_hz: float, bit_s: int, max_bit_s: int, key_frame_s: float) -> None:
        """`bit_s`: first rate; `max_bit_s`: highest rate; `key_frame_s`: longest time between key frames."""
        self._av = pyav()
        self._name = encoder
        self._rate_hz = rate_hz
        self._bit_s = bit_s
        self._max_bit_s = max_bit_s
        self._key_frame_s = key_frame_s
        self._context: Any = None

    def set_bitrate(self, bit_s: int) -> None:
        """Sets the rate from the next picture on."""
        self._bit_s = bit_s
        if bit_s > self._max_bit_s:
            self._max_bit_s, self._context = bit_s, None  # an open encoder cannot raise its limit
        elif self._context is not None:
            self._context.bit_rate = bit_s

    def encode(self, frame: Any, timestamp: int, *, key: bool) -> bytes:
        """Encodes a frame of PyAV; returns its byte stream, or b"" if the encoder keeps the picture.

        Units: the timestamp in 1/90 000 s. Raises: InvalidInput for a picture that cannot be encoded.
        """
        # yuv420p halves the resolution of the colours, and so needs even sizes
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
        # the longest distance of key frames; requested ones come in between
        context.gop_size = max(1, round(self._rate_hz * self._key_frame_s))
        context.max_b_frames = 0
        context.thread_count = 1  # several threads would make several slices, and wait for each other
        if self._name == "libx264":
            # x264 follows a changed rate only if a buffer of the receiver (VBV) is configured
            buffer_bits = int(self._max_bit_s * BUFFER_S)
            context.options = {
                **_SOFTWARE,
                "maxrate": str(self._max_bit_s),
                "bufsize": str(buffer_bits),
            }
        return context


class H264Decoder:
    """Decoder of one stream of H.264."""

    def __init__(self) -> None:
        self._av = pyav()
        self._context: Any = self._av.CodecContext.create("h264", "r")
        self._context.thread_count = 1
        self._context.flags |= 1 << 19  # AV_CODEC_FLAG_LOW_DELAY, so that no picture is kept back

    def decode(self, stream: bytes) -> list[Image]:
        """Decodes a byte stream; returns the pictures that it completes. Raises: WireError if it is
        damaged."""
        try:
            frames = self._context.decode(self._av.Packet(stream))
            return [to_image(frame) for frame in frames]
        except self._av.FFmpegError as error:
            raise WireError(f"H.264 of {len(stream)} bytes: {error}") from error


def to_image(frame: Any) -> Image:
    """Converts a frame of PyAV to pixels."""
    plane = frame.reformat(format="rgb24").planes[0]
    data, row = bytes(plane), frame.width * 3
    # PyAV pads the rows of a plane for alignment
    if plane.line_size != row:
        data = b"".join(
            data[at : at + row] for at in range(0, plane.line_size * frame.height, plane.line_size)
        )
    return Image(frame.width, frame.height, ImageEncoding.RGB8, data)


def to_frame(image: Image) -> Any:
    """Converts an image to a frame of PyAV. Raises: InvalidInput if the image is damaged."""
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
