"""Encoder and decoder on a real recording: through RTP with reordering, another rate, damage, sizes."""

from pathlib import Path
from typing import Any

import pytest

from swarmd.video.codec import H264Decoder, H264Encoder, to_frame, to_image
from swarmd.video.config import Config
from swarmd.video.core.h264_payload import nal_units, packetize, unit_type
from swarmd.video.core.receiver import Decode, VideoReceiver
from swarmd.video.core.rtp_packet import RtpPacket, encode
from swarmd.video.sources import RecordedVideo
from swarmware.errors import InvalidInput, WireError
from swarmware.types.perception import Image, ImageEncoding

pytest.importorskip("av", reason="video needs PyAV: the extra `video` is not installed")

RECORDING = Path(__file__).parents[2] / "data" / "video" / "bikes.mp4"
PICTURES = 40
TICKS = 3600


def streams(bit_s: int = 800_000) -> list[bytes]:
    """The first pictures of the recording, encoded; the 20th is a key frame."""
    recording, encoder = RecordedVideo(str(RECORDING)), H264Encoder("libx264", 25.0, bit_s, bit_s, 10.0)
    found = [encoder.encode(recording.read(), at * TICKS, key=at == 20) for at in range(PICTURES)]
    recording.close()
    return found


def luminance_error(one: Image, other: Image) -> float:
    """Mean difference of the bytes, of some thousand spread over the picture."""
    pairs = list(zip(one.data[::97], other.data[::97], strict=True))
    return sum(abs(first - second) for first, second in pairs) / len(pairs)


def test_a_recording_survives_packets_out_of_order() -> None:
    core, decoder, shown, number = VideoReceiver(Config(), 7, 0), H264Decoder(), [], 0
    for at, stream in enumerate(streams()):
        payloads = packetize(nal_units(stream), 500)
        packets = [
            encode(RtpPacket((number + index) & 0xFFFF, at * TICKS, 7, one, index == len(payloads) - 1))
            for index, one in enumerate(payloads)
        ]
        number += len(payloads)
        for packet in reversed(packets) if at else packets:
            for action in core.on_packet(packet, at * 40_000_000):
                if isinstance(action, Decode):
                    shown += decoder.decode(action.unit.stream)
    assert len(shown) == PICTURES
    recording = RecordedVideo(str(RECORDING))
    original = [to_image(recording.read()) for _ in range(PICTURES)]
    recording.close()
    assert {(one.width, one.height) for one in shown} == {(640, 272)}
    assert luminance_error(shown[-1], original[-1]) < 12
    assert luminance_error(shown[-1], original[0]) > 2 * luminance_error(shown[-1], original[-1])


def test_requested_key_frame_has_all_for_decoding() -> None:
    kinds = [{unit_type(unit) for unit in nal_units(stream)} for stream in streams()]
    assert [at for at, found in enumerate(kinds) if 5 in found] == [0, 20]
    assert {7, 8} <= kinds[20]
    (image,) = H264Decoder().decode(streams()[20])
    assert image.encoding == ImageEncoding.RGB8


def test_the_rate_changes_while_it_encodes() -> None:
    recording, encoder = (
        RecordedVideo(str(RECORDING)),
        H264Encoder("libx264", 25.0, 2_000_000, 2_000_000, 10.0),
    )
    fast = [len(encoder.encode(recording.read(), at * TICKS, key=False)) for at in range(50)]
    encoder.set_bitrate(200_000)
    slow = [len(encoder.encode(recording.read(), at * TICKS, key=False)) for at in range(50, 150)]
    assert sum(slow[50:]) < 0.3 * sum(fast), "the recording begins again at its end"
    encoder.set_bitrate(4_000_000)
    again = [len(encoder.encode(recording.read(), at * TICKS, key=False)) for at in range(150, 175)]
    recording.close()
    assert sum(again) > sum(slow[50:])


@pytest.mark.parametrize(
    "image",
    [
        Image(63, 33, ImageEncoding.RGB8, bytes(63 * 33 * 3)),
        Image(64, 32, ImageEncoding.MONO8, bytes(64 * 32)),
        Image(50, 34, ImageEncoding.MONO8, bytes(50 * 34)),
    ],
)
def test_any_image_size_is_encoded_rounded_down(image: Image) -> None:
    stream = H264Encoder("libx264", 25.0, 100_000, 100_000, 10.0).encode(to_frame(image), 0, key=True)
    (found,) = H264Decoder().decode(stream)
    assert (found.width, found.height) == (image.width & ~1, image.height & ~1)


def test_pixels_pass_unchanged_through_a_frame() -> None:
    data = bytes(range(256)) * 6
    image = Image(32, 16, ImageEncoding.RGB8, data)
    assert to_image(to_frame(image)) == image


def test_image_that_is_jpeg_file_is_read() -> None:
    import av

    context: Any = av.CodecContext.create("mjpeg", "w")
    context.width, context.height, context.pix_fmt, context.framerate = 64, 32, "yuvj420p", 25
    frame = av.VideoFrame(64, 32, "yuvj420p")
    frame.pts = 0
    (packet,) = list(context.encode(frame)) + list(context.encode(None))
    found = to_frame(Image(64, 32, ImageEncoding.JPEG, bytes(packet)))
    assert (found.width, found.height) == (64, 32)


@pytest.mark.parametrize(
    "image",
    [
        Image(4, 4, ImageEncoding.RGB8, b"short"),
        Image(0, 0, ImageEncoding.MONO8, b""),
        Image(4, 4, ImageEncoding.JPEG, b"no jpeg"),
        Image(9000, 1, ImageEncoding.MONO8, bytes(9000)),
        Image(4, 4, ImageEncoding("depth16"), bytes(32)),
    ],
)
def test_a_damaged_image_is_refused(image: Image) -> None:
    with pytest.raises(InvalidInput):
        to_frame(image)


def test_damaged_video_is_refused_until_key_frame() -> None:
    decoder, good = H264Decoder(), streams()
    for garbage in (b"\0\0\0\1\x65" + b"\xff" * 50, b"garbage", b"\0\0\0\1\x67\0"):
        try:
            assert decoder.decode(garbage) == []
        except WireError as error:
            assert "H.264 of" in str(error)
    assert decoder.decode(good[20])


@pytest.mark.parametrize("content", [b"no video", b""])
def test_file_without_video_is_refused_with_its_path(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "flight.mp4"
    file.write_bytes(content)
    with pytest.raises(InvalidInput, match=r"flight\.mp4.*expected a file with video"):
        RecordedVideo(str(file))
