"""The driver of cameras: sources of PyAV become a stream of images, and a lost source is reopened."""

import asyncio
from pathlib import Path
from typing import Literal

import av
import msgspec
import pytest
from tests.unit.hal.rig import running

from swarmd.hal.config import CameraDriver, Config
from swarmd.hal.driver import DeviceError, DeviceGone
from swarmd.hal.drivers.camera import Camera
from swarmware.module.jpeg import to_pixels
from swarmware.types.perception import Image

FAST = Config(drivers=(), retry_s=0.05, failures=2, report_hz=50.0)
PATTERN = CameraDriver(
    device="color=c=red:size=64x48:rate=50", format="lavfi", width=64, height=48, rate_hz=50.0
)
RECORDING = Path(__file__).parents[2] / "data" / "video" / "bikes.mp4"


def with_(config: CameraDriver, **settings: object) -> CameraDriver:
    return msgspec.structs.replace(config, **settings)


def picture(config: CameraDriver) -> Image:
    camera = Camera(config)
    camera.connect()
    try:
        return camera.measure()
    finally:
        camera.disconnect()


async def test_pictures_of_camera_are_stream_of_images(tmp_path: Path) -> None:
    async with running(tmp_path, [Camera(PATTERN)], FAST) as other:
        stream = other.stream_reader("sensor/camera", Image)
        async with asyncio.timeout(20.0):
            images = [await stream.next() for _ in range(3)]
        for image in images:
            assert (image.width, image.height, image.encoding) == (64, 48, "rgb8")
            assert len(image.data) == 64 * 48 * 3
            red, green, blue = image.data[:3]
            assert red > 240
            assert max(green, blue) < 16


@pytest.mark.parametrize(("encoding", "size"), [("mono8", 64 * 48), ("rgb8", 64 * 48 * 3)])
def test_pictures_have_the_encoding_that_is_configured(encoding: Literal["mono8", "rgb8"], size: int) -> None:
    assert len(picture(with_(PATTERN, encoding=encoding)).data) == size


def test_jpeg_is_compressed_or_taken_from_camera(tmp_path: Path) -> None:
    own = picture(with_(PATTERN, encoding="jpeg", quality=60))
    assert own.data[:2] == b"\xff\xd8"
    assert to_pixels(own).data[0] > 240
    file = tmp_path / "camera.avi"
    with av.open(str(file), "w") as made:
        stream = made.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        packets = [*stream.encode(av.VideoFrame(64, 48, "yuvj420p")), *stream.encode(None)]
        made.mux(packets)
        (compressed,) = map(bytes, packets)
    taken = picture(with_(PATTERN, device=str(file), format="", encoding="jpeg"))
    assert taken.data == compressed


def test_a_recording_of_another_size_is_scaled() -> None:
    image = picture(with_(PATTERN, device=str(RECORDING), format="", width=70, height=50))
    assert (image.width, image.height, len(image.data)) == (70, 50, 70 * 50 * 3)


def test_what_is_no_camera_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceGone, match=r"camera .*/video9: No such file"):
        picture(with_(PATTERN, device=str(tmp_path / "video9"), format="v4l2"))
    text = tmp_path / "text"
    text.write_text("no pictures in here")
    with pytest.raises(DeviceError, match="expected a source of video"):
        picture(with_(PATTERN, device=str(text), format=""))


async def test_a_camera_whose_pictures_end_is_opened_again(tmp_path: Path) -> None:
    ending = with_(PATTERN, device="color=c=red:size=64x48:rate=50:duration=0.1")
    async with running(tmp_path, [Camera(ending)], FAST) as other:
        stream = other.stream_reader("sensor/camera", Image)
        async with asyncio.timeout(20.0):
            for _ in range(12):  # five in each opening
                await stream.next()
