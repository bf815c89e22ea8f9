"""H.264 in RTP: whole, aggregated and fragmented NAL units (RFC 6184); damaged payloads are refused."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.video.core.h264_payload import (
    FU_A,
    STAP_A,
    UNIT_MAX,
    AccessUnit,
    Depacketizer,
    nal_units,
    packetize,
)
from swarmware.errors import WireError

SPS_UNIT = bytes.fromhex("6742c015da02808e84")
PPS_UNIT = bytes.fromhex("68ce3c80")
PPS_STORED = PPS_UNIT[:-1] + b"\x81"


def test_byte_stream_is_split_at_start_codes() -> None:
    stream = b"\0\0\0\1" + SPS_UNIT + b"\0\0\1" + PPS_STORED + b"\0\0\0\1" + b"\x65abc\0\0"
    assert nal_units(stream) == [SPS_UNIT, PPS_STORED, b"\x65abc"]
    assert nal_units(b"") == nal_units(b"no start code") == []


def test_small_units_travel_together_as_stap_a() -> None:
    (payload,) = packetize([SPS_UNIT, PPS_STORED, b"\x65abc"], 1000)
    # RFC 6184, section 5.7.1: the highest importance of the units, sizes of 16 bits
    expected = bytes((0x60 | STAP_A,))
    for unit in (SPS_UNIT, PPS_STORED, b"\x65abc"):
        expected += len(unit).to_bytes(2) + unit
    assert payload == expected


def test_one_unit_that_fits_is_its_own_payload() -> None:
    assert packetize([b"\x41" + bytes(99)], 100) == [b"\x41" + bytes(99)]


def test_large_unit_travels_in_marked_fragments() -> None:
    unit = b"\x65" + bytes(range(1, 251))
    payloads = packetize([unit], 102)
    # RFC 6184, section 5.8: indicator with the importance, header with start, end and type
    assert [one[:2].hex() for one in payloads] == ["7c85", "7c05", "7c45"]
    assert b"".join(one[2:] for one in payloads) == unit[1:]
    assert all(len(one) <= 102 for one in payloads)


def test_units_around_a_large_one_keep_their_order() -> None:
    units = [SPS_UNIT, PPS_STORED, b"\x65" + b"x" * 300, b"\x06sei"]
    taker = Depacketizer()
    payloads = packetize(units, 100)
    done = [one for at, p in enumerate(payloads) for one in taker.on_payload(p, 9, at == len(payloads) - 1)]
    assert done == [AccessUnit(9, tuple(units))]
    assert done[0].is_key
    assert nal_units(done[0].stream) == units


@given(
    st.lists(st.binary(min_size=1, max_size=400).map(lambda rest: b"\x41" + rest), min_size=1, max_size=9),
    st.integers(64, 300),
)
def test_every_picture_comes_back_whole(units: list[bytes], payload_max: int) -> None:
    payloads, taker = packetize(units, payload_max), Depacketizer()
    assert all(len(one) <= payload_max for one in payloads)
    done = [one for at, p in enumerate(payloads) for one in taker.on_payload(p, 1, at == len(payloads) - 1)]
    assert done == [AccessUnit(1, tuple(units))]


def test_picture_without_its_marker_ends_with_next_timestamp() -> None:
    taker = Depacketizer()
    assert taker.on_payload(b"\x41a", 1, False) == []
    assert taker.on_payload(b"\x41b", 2, True) == [AccessUnit(1, (b"\x41a",)), AccessUnit(2, (b"\x41b",))]


def test_picture_with_gap_is_dropped_next_whole() -> None:
    first, _, last = packetize([b"\x65" + bytes(250)], 102)
    taker = Depacketizer()
    assert taker.on_payload(first, 1, False) == []
    taker.on_gap()
    assert taker.on_payload(last, 1, True) == []
    assert taker.damaged == 1
    assert taker.on_payload(b"\x41b", 2, True) == [AccessUnit(2, (b"\x41b",))]
    assert taker.damaged == 1


@pytest.mark.parametrize(
    "payloads",
    [
        [b""],
        [b"\xc1forbidden bit"],
        [b"\x19STAP-B"],
        [b"\x1dFU-B"],
        [bytes((FU_A, 0x85))],
        [bytes((FU_A, 0x05)) + b"no start"],
        [bytes((FU_A, 0x85)) + b"a", bytes((FU_A, 0x85)) + b"a second start"],
        [bytes((FU_A, 0x85)) + b"a", b"\x41inside"],
        [bytes((FU_A, 0x9C)) + b"a fragment of fragments"],
        [bytes((STAP_A,))],
        [bytes((STAP_A, 0, 9)) + b"\x41"],
        [bytes((STAP_A, 0, 0, 0))],
        [bytes((STAP_A, 0, 1, STAP_A))],
    ],
)
def test_damaged_payload_is_refused_and_drops_its_picture(payloads: list[bytes]) -> None:
    taker = Depacketizer()
    for payload in payloads[:-1]:
        taker.on_payload(payload, 1, False)
    with pytest.raises(WireError):
        taker.on_payload(payloads[-1], 1, False)
    assert taker.on_payload(b"\x41more", 1, True) == []
    assert taker.damaged == 1
    assert taker.on_payload(b"\x41b", 2, True) == [AccessUnit(2, (b"\x41b",))]


def test_picture_without_end_does_not_fill_memory() -> None:
    taker = Depacketizer()
    with pytest.raises(WireError, match="more than"):
        for _ in range(UNIT_MAX // 60_000 + 2):
            taker.on_payload(b"\x41" + bytes(60_000), 1, False)


@given(st.lists(st.tuples(st.binary(max_size=40), st.integers(0, 2), st.booleans()), max_size=20))
def test_garbage_is_a_picture_or_refused(payloads: list[tuple[bytes, int, bool]]) -> None:
    taker = Depacketizer()
    for payload, timestamp, marker in payloads:
        with suppress(WireError):
            assert all(one.units for one in taker.on_payload(payload, timestamp, marker))
