"""Driver of a camera, with PyAV from Video4Linux, a network stream or a file (S0.8, S1.74)."""

from collections.abc import Iterator
from types import ModuleType
from typing import Any, Final

from swarmd.hal.blocking import BlockingSensor
from swarmd.hal.config import CameraDriver, Config
from swarmd.hal.driver import Device, DeviceError, DeviceGone, Site
from swarmware.errors import SwarmError
from swarmware.module.jpeg import to_jpeg
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.perception import Image, ImageEncoding

PIXELS: Final = {ImageEncoding.RGB8: ("rgb24", 3), ImageEncoding.MONO8: ("gray", 1)}
"""Format of PyAV and bytes per pixel by encoding; JPEG is compressed from RGB."""
SLOTS: Final = 4


def pyav() -> ModuleType:
    """Imports PyAV. Raises: DeviceError where it is not installed."""
    try:
        import av
    except ImportError:
        raise DeviceError("a camera needs PyAV: pip install 'swarmware[video]'") from None
    return av


class Camera(BlockingSensor[Image]):
    """Publishes pictures as a stream of images, and waits for the camera in a thread."""

    name = "camera"

    def __init__(self, config: CameraDriver) -> None:
        # the camera sets the pace, because a call waits for the next picture
        self.period_s = 1 / config.rate_hz
        self._config = config
        self._encoding = ImageEncoding(config.encoding)
        self._writer: BoardWriter[Image] | None = None
        self._container: Any = None
        self._images: Iterator[Image] = iter(())

    async def open(self, module: Module) -> None:
        """Opens the camera and its stream. Raises: DeviceError, DeviceGone."""
        await super().open(module)
        config = self._config
        writer = module.stream_writer(
            config.path,
            Image,
            rate_hz=config.rate_hz,
            link="request",
            slots=SLOTS,
            slot_bytes=config.width * config.height * 3 + 256,
            description="Pictures of the camera",
        )
        self._writer = self.managed(module, writer)

    def connect(self) -> None:
        """Opens the camera with its size and rate. Raises: DeviceGone, DeviceError."""
        config, av = self._config, pyav()
        options = {"video_size": f"{config.width}x{config.height}", "framerate": f"{config.rate_hz:g}"}
        # cameras compress faster than the processor, and a USB line carries more of such pictures
        if config.format == "v4l2" and self._encoding == ImageEncoding.JPEG:
            options["input_format"] = "mjpeg"
        try:
            self._container = av.open(
                config.device,
                format=config.format or None,
                options=options if config.format == "v4l2" else {},
            )
            stream = self._container.streams.video[0]
        except FileNotFoundError as error:
            raise DeviceGone(f"camera {config.device}: {error.strerror}") from error
        except (OSError, IndexError, ValueError, av.FFmpegError) as error:
            raise DeviceError(f"camera {config.device}: {error}; expected a source of video") from error
        if self._encoding == ImageEncoding.JPEG and stream.codec_context.name == "mjpeg":
            self._images = self._compressed(stream)
        else:
            self._images = self._decoded(stream)

    def _compressed(self, stream: Any) -> Iterator[Image]:
        """Yields the JPEG pictures of a compressing camera, without decoding them."""
        for packet in self._container.demux(stream):
            # an empty packet flushes the decoder at the end, and is not a picture
            if packet.size:
                yield Image(stream.width, stream.height, ImageEncoding.JPEG, bytes(packet))

    def _decoded(self, stream: Any) -> Iterator[Image]:
        config = self._config
        jpeg = self._encoding == ImageEncoding.JPEG
        pixels = ImageEncoding.RGB8 if jpeg else self._encoding
        name, pixel_bytes = PIXELS[pixels]
        for frame in self._container.decode(stream):
            plane = frame.reformat(config.width, config.height, format=name).planes[0]
            data, row, size = bytes(plane), config.width * pixel_bytes, plane.line_size
            # decoders align the rows in memory, and an image has them without gaps
            if size != row:
                data = b"".join(data[at : at + row] for at in range(0, size * config.height, size))
            image = Image(config.width, config.height, pixels, data)
            yield to_jpeg(image, config.quality) if jpeg else image

    def measure(self) -> Image:
        """Waits for the next picture. Raises: DeviceGone at the end of the source, DeviceError."""
        try:
            return next(self._images)
        except StopIteration:
            raise DeviceGone(f"camera {self._config.device}: the source has ended") from None
        except (OSError, ValueError, pyav().FFmpegError) as error:
            raise DeviceError(f"camera {self._config.device}: {error}") from error
        except SwarmError as error:
            raise DeviceError(f"camera {self._config.device}: {error}") from error

    def publish(self, value: Image, now_ns: int) -> bool:
        """Writes the picture to its stream."""
        if self._writer is not None:
            self._writer.write(value, now_ns)
        return True

    def disconnect(self) -> None:
        """Closes the source of pictures."""
        container, self._container, self._images = self._container, None, iter(())
        if container is not None:
            container.close()


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the camera."""
    return [Camera(config.camera)]
