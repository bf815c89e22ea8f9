"""Images and point clouds: JPEG and back, damaged files, records for compression."""

import struct
import sys

import msgspec
import pytest

from swarmware.errors import InvalidInput, NotFound, WireError
from swarmware.model.compression import Compression, pack, unpack
from swarmware.model.record_filter import NO_RECORDS, Layout, Records
from swarmware.module.jpeg import to_jpeg, to_pixels
from swarmware.types import registry
from swarmware.types.perception import Image, ImageEncoding, PointCloud, PointField
from swarmware.types.scalar import Blob

WIDTH, HEIGHT = 64, 48


def picture(channels: int = 3) -> Image:
    """A gradient, as a camera sees the sky."""
    data = bytes(
        (2 * x + 3 * y + 20 * channel) % 256
        for y in range(HEIGHT)
        for x in range(WIDTH)
        for channel in range(channels)
    )
    return Image(WIDTH, HEIGHT, ImageEncoding.RGB8 if channels == 3 else ImageEncoding.MONO8, data)


@pytest.mark.parametrize("channels", [1, 3])
def test_jpeg_picture_is_smaller_and_looks_same(channels: int) -> None:
    before = picture(channels)
    coded = to_jpeg(before, 80)
    assert coded.encoding is ImageEncoding.JPEG
    assert len(coded.data) < len(before.data) / 2
    after = to_pixels(coded)
    assert (after.width, after.height, after.encoding) == (WIDTH, HEIGHT, before.encoding)
    error = sum(abs(a - b) for a, b in zip(before.data, after.data, strict=True)) / len(before.data)
    assert error < 8


def test_a_jpeg_stays_and_so_do_pixels() -> None:
    coded = to_jpeg(picture(), 50)
    assert to_jpeg(coded, 90) is coded
    assert to_pixels(picture()) == picture()


def test_a_better_quality_is_larger() -> None:
    assert len(to_jpeg(picture(), 30).data) < len(to_jpeg(picture(), 95).data)


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (Image(WIDTH, HEIGHT, ImageEncoding.RGB8, bytes(5)), "expected 9216"),
        (Image(0, 0, ImageEncoding.RGB8, b""), "expected 0"),
        (Image(1, 1, ImageEncoding("yuv422"), bytes(2)), "expected one of mono8, rgb8"),
    ],
)
def test_pixels_that_cannot_be_coded_are_refused(image: Image, reason: str) -> None:
    with pytest.raises(InvalidInput, match=reason):
        to_jpeg(image, 80)


def test_damaged_or_differently_sized_jpeg_is_refused() -> None:
    coded = to_jpeg(picture(), 80)
    for data in (b"", b"garbage", coded.data[:20]):
        with pytest.raises(WireError, match="JPEG"):
            to_pixels(msgspec.structs.replace(coded, data=data))
    with pytest.raises(WireError, match=r"64x48: stated are 65x48"):
        to_pixels(msgspec.structs.replace(coded, width=65))


def test_without_pillow_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    with pytest.raises(NotFound, match=r"swarmware\[images\]"):
        to_jpeg(picture(), 80)


def test_a_point_cloud_is_compressed_by_its_points() -> None:
    points = b"".join(struct.pack("<fff4xfH10x", x / 7, x / 3, 1.0, x % 9, x % 16) for x in range(2000))
    cloud = PointCloud((PointField("x", 0, "f4"), PointField("ring", 20, "u2")), 32, points)
    payload = registry.encode(cloud)
    records = registry.records("PointCloud", payload)
    assert records == Records(Layout.RECORDS, 32, len(points))
    packed = pack(payload, Compression.parse("zlib"), records)
    assert len(packed) < len(pack(payload, Compression.parse("zlib")))
    assert registry.decode(PointCloud, unpack(packed)) == cloud


def test_other_values_have_no_records() -> None:
    assert registry.records("Blob", registry.encode(Blob(b"text"))) == NO_RECORDS
    assert registry.records("Blob", b"damaged") == NO_RECORDS
    assert registry.records("Pose", b"") == NO_RECORDS
    assert registry.records("OfTheUser", b"") == NO_RECORDS
    assert registry.records("PointCloud", registry.encode(PointCloud((), 0, b"x"))) == NO_RECORDS
