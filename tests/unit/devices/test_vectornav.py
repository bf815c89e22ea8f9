"""Frames of a VectorNav unit: angles and axes, damage, other outputs."""

import binascii
import math
import struct

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.devices.vectornav import FRAME_BYTES, VectorNavDecoder, frame
from swarmware.types.vehicle import Imu

NORTH_EAST = Imu(0.5, -0.25, 0.125, 1.0, 2.0, 9.75, math.pi / 4)


def raw(*values: float) -> bytes:
    """A frame written from the manual alone: yaw, pitch, roll, rates, accelerations."""
    checked = struct.pack("<BH9f", 1, 0x0128, *values)
    crc = 0
    for byte in checked:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return b"\xfa" + checked + struct.pack(">H", crc)


def test_unit_facing_east_turns_right_clockwise() -> None:
    (found,) = VectorNavDecoder().feed(raw(90.0, 0, 0, 0.0, 0.0, 0.5, 0.0, 1.0, -9.75))
    assert found.yaw_rad == 0.0
    assert found.wz_rad_s == -0.5
    assert (found.ay_m_s2, found.az_m_s2) == (-1.0, 9.75)
    assert (found.roll_rad, found.pitch_rad) == (0.0, 0.0)
    (north,) = VectorNavDecoder().feed(raw(0.0, *[0.0] * 8))
    assert north.yaw_rad == math.pi / 2


def test_what_is_sent_is_what_is_read() -> None:
    sent = frame(NORTH_EAST)
    assert len(sent) == FRAME_BYTES
    assert sent == raw(45.0, 0, 0, 0.5, 0.25, -0.125, 1.0, -2.0, -9.75)
    tilted = msgspec.structs.replace(NORTH_EAST, roll_rad=math.radians(10.0), pitch_rad=math.radians(-5.0))
    assert frame(tilted) == raw(45.0, 5.0, 10.0, 0.5, 0.25, -0.125, 1.0, -2.0, -9.75), (
        "nose up, right side down"
    )
    (again,) = VectorNavDecoder().feed(frame(tilted))
    assert [again.roll_rad, again.pitch_rad] == pytest.approx([tilted.roll_rad, tilted.pitch_rad])
    (found,) = VectorNavDecoder().feed(sent)
    assert found.yaw_rad is not None
    assert abs(found.yaw_rad - math.pi / 4) < 1e-6
    assert binascii.crc_hqx(sent[1:], 0) == 0


@given(st.lists(st.binary(max_size=100), max_size=8), st.integers(1, 41))
def test_frames_are_found_after_noise_in_crsf(chunks: list[bytes], cut: int) -> None:
    decoder = VectorNavDecoder()
    for chunk in chunks:
        for found in decoder.feed(chunk):
            assert math.isfinite(found.ax_m_s2)
        assert len(decoder._open) < FRAME_BYTES
    sent = frame(NORTH_EAST)
    damaged = bytearray(sent)
    damaged[cut] ^= 0x10
    before = decoder.valid
    list(decoder.feed(bytes(damaged) + sent[:7]))
    list(decoder.feed(sent[7:] + sent + sent))
    assert decoder.valid >= before + 2, "at most the frame in the tail of the garbage is lost"


def test_foreign_output_and_range_are_refused_by_name() -> None:
    decoder = VectorNavDecoder()
    assert list(decoder.feed(b"\xfa\x01\x29\x01" + bytes(40))) == []
    assert list(decoder.feed(raw(math.nan, *[0.0] * 8))) == []
    assert list(decoder.feed(raw(0.0, 0.0, 0.0, 1e9, *[0.0] * 5))) == []
    assert decoder.refused["another output: expected group 1 with the fields 0x0128"] == 1
    assert decoder.refused["value out of range"] == 2
