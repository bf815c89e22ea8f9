"""Frames of u-blox receivers: their check, and the position in NAV-PVT."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.devices.receivers import pvt

from swarmware.devices import ubx
from swarmware.devices.gnss_receiver import ReceiverDecoder
from swarmware.errors import WireError
from swarmware.types.vehicle import GnssFix


def test_the_checksum_is_that_of_the_description() -> None:
    # poll of MON-VER, and CFG-RATE at 5 Hz, as they are printed in many manuals
    assert ubx.frame((0x0A, 0x04), b"") == bytes.fromhex("b5620a0400000e34")
    rate = bytes.fromhex("b5620608060 0c80001000100de6a".replace(" ", ""))
    assert ubx.frame((0x06, 0x08), rate[6:-2]) == rate


def test_nav_pvt_is_a_fix() -> None:
    assert len(pvt()) == 92
    for payload in (pvt(), pvt()[:84], pvt() + bytes(4)):
        found = ubx.nav_pvt(payload)
        assert found.fix == GnssFix(47.285233, 8.565265, 547.6, 0.812, 12)
        assert found.time_s == 86_397.5
    flat = ubx.nav_pvt(pvt(fix_type=2)).fix
    assert flat is not None
    assert math.isnan(flat.alt_ellipsoid_m)


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (pvt(fix_type=0), "NAV-PVT: no fix"),
        (pvt(fix_type=1), "NAV-PVT: dead reckoning"),
        (pvt(fix_type=5), "NAV-PVT: time only"),
        (pvt(flags=0), "NAV-PVT: the receiver does not trust its fix"),
        (pvt(flags3=1), "NAV-PVT: the receiver does not trust its fix"),
    ],
)
def test_a_receiver_without_a_fix_says_why(payload: bytes, reason: str) -> None:
    found = ubx.nav_pvt(payload)
    assert (found.fix, found.reason) == (None, reason)


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (pvt(satellites=0), "a fix without satellites"),
        (pvt(accuracy_mm=0), "a fix without accuracy"),
        (pvt(lat_e7=900000001), "position out of range"),
        (pvt(lon_e7=-1800000001), "position out of range"),
        (pvt()[:83], "NAV-PVT of 83 bytes, expected 84 or more"),
    ],
)
def test_what_is_no_fix_is_refused_by_name(payload: bytes, reason: str) -> None:
    with pytest.raises(WireError, match=reason):
        ubx.nav_pvt(payload)
    decoder = ReceiverDecoder()
    assert not list(decoder.feed(ubx.frame(ubx.NAV_PVT, payload)))
    assert decoder.valid == 1
    assert reason in decoder.reason
    assert len(list(decoder.feed(ubx.frame(ubx.NAV_PVT, pvt())))) == 1
    assert decoder.reason.startswith("none with a position")


@pytest.mark.parametrize("opened", [b"", b"\xb5", b"\xb5\x62", b"\xb5\x62\x01\x07\x5c"])
def test_length_of_frame_is_known_after_its_header(opened: bytes) -> None:
    assert ubx.frame_bytes(opened) is None
    assert ubx.frame_bytes(b"\xb5\x62\x01\x07\x5c\x00") == 100
    with pytest.raises(WireError, match="longer than 1024"):
        ubx.frame_bytes(b"\xb5\x62\x01\x07\x01\x04")
    with pytest.raises(WireError, match="no frame"):
        ubx.frame_bytes(b"\xb5\x63")


@given(st.binary(max_size=120))
def test_any_payload_is_a_position_or_refused(payload: bytes) -> None:
    frame = ubx.frame(ubx.NAV_PVT, payload)
    assert ubx.frame_of(frame) == ubx.UbxFrame(ubx.NAV_PVT, payload)
    try:
        found = ubx.position(ubx.frame_of(frame))
    except WireError:
        return
    assert found is not None
    if found.fix is not None:
        assert abs(found.fix.lat_deg) <= 90
        assert found.fix.sigma_m >= 0.01


@given(st.binary(min_size=8, max_size=40), st.integers(0, 7), st.integers(1, 255))
def test_a_damaged_frame_is_refused(payload: bytes, at: int, change: int) -> None:
    frame = bytearray(ubx.frame((0x02, 0x15), payload))
    frame[6 + at] ^= change
    with pytest.raises(WireError, match="checksum wrong"):
        ubx.frame_of(bytes(frame))
