"""Frames of a radio-control receiver: the example of the protocol, both ends of the sticks, damage."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.devices.crsf import CrsfDecoder, RcChannels, RcLink, channels_frame, crc8, link_frame

CENTRED = bytes.fromhex("c81816e0031ff8c0073ef0810f7ce0031ff8c0073ef0810f7cad")
"""All channels at 1500 µs. Source: the page of the protocol's working group on packed channels."""


def test_example_of_protocol_is_read_and_written() -> None:
    assert channels_frame([]) == CENTRED
    (found,) = CrsfDecoder().feed(CENTRED)
    assert found == RcChannels((0.0,) * 16)


def test_the_ends_of_all_sticks_arrive() -> None:
    sent = [1.0, -1.0, 0.5, -0.25, *[0.0] * 11, 1.0]
    (found,) = CrsfDecoder().feed(channels_frame(sent))
    assert isinstance(found, RcChannels)
    assert found.positions == pytest.approx(sent, abs=1e-3)
    assert channels_frame([2.0]) == channels_frame([1.0])


def test_link_quality_is_ratio_others_are_skipped() -> None:
    decoder = CrsfDecoder()
    battery = b"\x08" + bytes(8)
    data = link_frame(0.75) + bytes([0xC8, len(battery) + 1]) + battery + bytes([crc8(battery)])
    assert list(decoder.feed(data + link_frame(0.0))) == [RcLink(0.75), RcLink(0.0)]
    assert decoder.valid == 3
    assert not decoder.refused


@given(st.lists(st.binary(max_size=100), max_size=8))
def test_frames_are_found_after_noise_in_crsf(chunks: list[bytes]) -> None:
    decoder = CrsfDecoder()
    for chunk in chunks:
        for found in decoder.feed(chunk):
            if isinstance(found, RcChannels):
                assert all(-1 <= position <= 1 for position in found.positions)
        assert len(decoder._open) <= 64
    before = decoder.valid
    list(decoder.feed(CENTRED * 4))
    assert decoder.valid > before


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (CENTRED[:-1] + b"\x00", "CRC wrong"),
        (b"\xc8\xff" + bytes(4), "length out of range"),
        (bytes.fromhex("c80316aa") + bytes([crc8(b"\x16\xaa")]), "channels of 1 bytes, expected 22"),
        (bytes.fromhex("c80314aa") + bytes([crc8(b"\x14\xaa")]), "link of 1 bytes, expected 10"),
        (b"\x00\x01", "no frame"),
    ],
)
def test_a_damaged_frame_is_refused_by_name(data: bytes, reason: str) -> None:
    decoder = CrsfDecoder()
    assert list(decoder.feed(data)) == []
    assert decoder.refused[reason] == 1
