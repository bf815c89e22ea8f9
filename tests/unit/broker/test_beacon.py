"""The beacon, byte by byte, and what happens to bytes that are none."""

import contextlib
import struct
from collections.abc import Sequence
from itertools import accumulate
from typing import TypeVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import (
    AGE_UNIT_US,
    HOPS_MAX,
    INFINITY,
    NO_ECHO,
    Beacon,
    BoardValue,
    Echo,
    Header,
    Hello,
    MemberRow,
    NeighbourRequest,
    PlatformCode,
    RelayedValue,
    RouteRow,
    SequenceRequest,
    decode_age,
    encode_age,
)
from swarmd.broker.core.beacon.parts.medium_parts import MediumListing, encode_media, media_bytes
from swarmd.broker.core.beacon.parts.session_checks import (
    PORT_PART_BYTES,
    CheckKind,
    SessionCheck,
    body_bytes,
)
from swarmd.broker.core.beacon.parts.solicitation import Solicitation, solicitation_bytes
from swarmd.broker.core.beacon.parts.structure_parts import (
    StructurePart,
    encode_questions,
    encode_structure,
    question_bytes,
    structure_bytes,
)
from swarmd.broker.core.beacon.request_parts import request_part_bytes
from swarmware.errors import WireError

T = TypeVar("T")

U8, U16, U32 = st.integers(0, 255), st.integers(0, 0xFFFF), st.integers(0, 2**32 - 1)
U64 = st.integers(0, 2**64 - 1)
NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,30}(\.[a-z]{1,8})?", fullmatch=True)
FINE_AGES = st.integers(0, 0x7FFF).map(lambda units: units * AGE_UNIT_US)
PAYLOADS = st.binary(max_size=200)


def some(elements: st.SearchStrategy[T]) -> st.SearchStrategy[tuple[T, ...]]:
    return st.lists(elements, max_size=5).map(tuple)


HELLOS = st.builds(
    Hello,
    boot_id=U64,
    clock_high=st.integers(-(2**31), 2**31 - 1),
    tcp_port=U16,
    tree_version=U32,
    mission=U32,
    kind=st.sampled_from(PlatformCode),
    name=NAMES,
    curve_public=st.sampled_from([b"", bytes(range(32))]),
    period_ms=U16,
    listing_ms=U16,
    frame_port=U16,
)
BEACONS = st.builds(
    Beacon,
    hello=st.none() | HELLOS,
    echoes=some(st.builds(Echo, U32, U8, st.integers(0, NO_ECHO), U8)),
    rows=some(st.builds(RouteRow, U32, U16, U16)),
    requests=some(st.builds(SequenceRequest, U32, U16, U8)),
    members=some(st.builds(MemberRow, U32, U32, st.sampled_from(PlatformCode), NAMES)),
    values=some(st.builds(BoardValue, U32, FINE_AGES, st.booleans(), PAYLOADS)),
    relays=some(
        st.builds(
            RelayedValue,
            U32,
            U32,
            st.integers(-(2**47), 2**47 - 1),
            FINE_AGES,
            st.integers(1, HOPS_MAX),
            st.booleans(),
            PAYLOADS,
        )
    ),
    checks=some(st.builds(SessionCheck, U8, U32, U32)),
    structure=st.none() | st.builds(StructurePart, U32, U64, U64, PAYLOADS),
    structure_questions=some(U32),
    media=some(st.builds(MediumListing, U32, U16, U8)),
    neighbour_requests=some(st.builds(NeighbourRequest, U32, U16 | U32, U16, U8)),
    solicitation=st.none() | st.builds(Solicitation, U16, some(U32)),
)
HEADERS = st.builds(
    Header, epoch=st.integers(0, 15), sender_hw=U32, sequence=U32, tx_us=U32, session=st.none() | U64
)


@given(BEACONS)
def test_what_was_encoded_is_decoded_again(beacon: Beacon) -> None:
    assert codec.decode(codec.encode(beacon)) == beacon


@given(HEADERS)
def test_the_clear_header_comes_back_with_its_length(header: Header) -> None:
    data = codec.encode_header(header)
    assert codec.decode_header(data + b"sealed") == (header, len(data))
    assert codec.sender_of(data) == header.sender_hw


@given(st.binary(max_size=400))
def test_any_bytes_are_beacon_or_wire_error(data: bytes) -> None:
    with contextlib.suppress(WireError):
        codec.decode(data)


@given(BEACONS, st.data())
def test_damaged_beacon_is_beacon_or_wire_error(beacon: Beacon, data: st.DataObject) -> None:
    body = bytearray(codec.encode(beacon))
    for _ in range(data.draw(st.integers(1, 4))):
        body[data.draw(st.integers(0, len(body) - 1))] = data.draw(U8)
    with contextlib.suppress(WireError):
        assert isinstance(codec.decode(bytes(body)), Beacon)


@given(BEACONS)
def test_beacon_cut_short_anywhere_is_wire_error(beacon: Beacon) -> None:
    body = codec.encode(beacon)
    parts = [
        body_bytes(len(beacon.checks)),
        PORT_PART_BYTES if beacon.hello is not None and beacon.hello.frame_port else 0,
        structure_bytes(beacon.structure),
        question_bytes(len(beacon.structure_questions)),
        media_bytes(len(beacon.media)),
        request_part_bytes(beacon.neighbour_requests),
        solicitation_bytes(len(beacon.solicitation.asked)) if beacon.solicitation is not None else 0,
    ]
    first = len(body) - sum(parts)
    # without its last extra parts it is a whole beacon, if one is left
    whole = {first + size for size in accumulate(parts) if size}
    for length in range(len(body)):
        if length in whole:
            continue
        with pytest.raises(WireError):
            codec.decode(body[:length])


@given(st.binary(max_size=40))
def test_any_bytes_are_header_or_wire_error(data: bytes) -> None:
    with contextlib.suppress(WireError):
        codec.decode_header(data)


def test_header_is_one_of_protocol_page() -> None:
    short = codec.encode_header(Header(5, 0x11223344, 0x55667788, 0x99AABBCC))
    assert short == bytes.fromhex("54 25 44332211 88776655 ccbbaa99")
    long = codec.encode_header(Header(5, 0x11223344, 0x55667788, 0x99AABBCC, 0x0102030405060708))
    assert long == bytes.fromhex("54 35 44332211 88776655 ccbbaa99 0807060504030201")


def test_body_is_one_of_protocol_page() -> None:
    hello = Hello(
        0x0102030405060708, 2, 7447, 0xAABBCCDD, 0x11223344, PlatformCode.UGV, "ugv1", b"", 450, 2000
    )
    beacon = Beacon(
        hello,
        (Echo(0x0A0B0C0D, 0x7F, 0x030201, 255),),
        (RouteRow(0x0A0B0C0D, 0x1234, 256),),
        (SequenceRequest(0x0A0B0C0D, 0x1235, 24),),
        (MemberRow(0x0A0B0C0D, 9, PlatformCode.UAV, "uav2"),),
        (BoardValue(0x01020304, 12_300, True, b"pose"),),
        (RelayedValue(0x0A0B0C0D, 0x01020304, 0x060504030201, 4_000_000, 2, False, b"x"),),
        (SessionCheck(CheckKind.ANSWER, 0x0A0B0C0D, 0x04030201),),
    )
    assert codec.encode(beacon) == b"".join(
        (
            b"\xff",
            b"\x20" + struct.pack("<QiHII", 0x0102030405060708, 2, 7447, 0xAABBCCDD, 0x11223344),
            struct.pack("<HHBB", 450, 2000, 2, 0),
            b"ugv1",
            b"\x01" + bytes.fromhex("0d0c0b0a 7f 010203 ff"),
            b"\x01" + bytes.fromhex("0d0c0b0a 3412 0001"),
            b"\x01" + bytes.fromhex("0d0c0b0a 3512 18"),
            b"\x01" + bytes.fromhex("0d0c0b0a 09000000 01 04") + b"uav2",
            b"\x01" + bytes.fromhex("04030201 7b00 84") + b"pose",
            b"\x01" + bytes.fromhex("0d0c0b0a 04030201 010203040506 2880 02 01") + b"x",
            bytes.fromhex("01 0900 02 0d0c0b0a 01020304"),
        )
    )


def test_long_value_has_its_length_in_two_bytes() -> None:
    for length in (126, 127, 128, 1100):
        beacon = Beacon(values=(BoardValue(1, 0, True, bytes(length)),))
        assert len(codec.encode(beacon)) == 2 + codec.value_bytes(bytes(length))
        assert codec.decode(codec.encode(beacon)) == beacon


def test_parts_of_a_later_version_are_skipped() -> None:
    body = bytearray(codec.encode(Beacon(rows=(RouteRow(1, 2, 3),))))
    body[0] |= codec.Section.EXTRA
    body += struct.pack("<BH", 77, 5) + b"12345" + struct.pack("<BH", 78, 0)
    assert codec.decode(bytes(body)) == Beacon(rows=(RouteRow(1, 2, 3),))


def test_parts_about_structures_are_those_of_protocol_page() -> None:
    part = StructurePart(0x01020304, 0x1112131415161718, 0x2122232425262728, b"changes")
    head = bytes.fromhex("04 1b00 04030201 1817161514131211 2827262524232221")
    assert encode_structure(part) == head + b"changes"
    media = (MediumListing(0x0A0B0C0D, 0x0102, 255),)
    assert encode_media(media) == bytes.fromhex("07 0700 0d0c0b0a 0201 ff")
    assert encode_questions((0x0A0B0C0D, 1)) == bytes.fromhex("05 0800 0d0c0b0a 01000000")


def test_a_structure_that_is_cut_short_is_refused() -> None:
    body = codec.append_statement(codec.encode(Beacon()), bytes.fromhex("04 0300 010203"))
    with pytest.raises(WireError):
        codec.decode(body)


def test_bytes_behind_the_last_part_are_refused() -> None:
    with pytest.raises(WireError, match="1 bytes after its last section"):
        codec.decode(codec.encode(Beacon()) + b"x")


def test_an_unknown_kind_of_platform_is_another_one() -> None:
    body = bytearray(codec.encode(Beacon(members=(MemberRow(1, 2, PlatformCode.UAV, "a"),))))
    body[2 + 8] = 200
    assert codec.decode(bytes(body)).members[0].kind is PlatformCode.OTHER


@pytest.mark.parametrize("version", [3, 7])
def test_a_version_two_steps_ahead_is_refused(version: int) -> None:
    data = bytearray(codec.encode_header(Header(0, 1, 2, 3)))
    data[1] = version << 5
    with pytest.raises(WireError, match="expected a beacon of version 1"):
        codec.decode_header(bytes(data))


@pytest.mark.parametrize(
    ("age_us", "read_us"),
    [(-5, 0), (99, 0), (100, 100), (3_276_700, 3_276_700), (3_276_800, 3_200_000), (10**10, 3_276_700_000)],
)
def test_young_ages_are_fine_and_old_coarse(age_us: int, read_us: int) -> None:
    assert decode_age(encode_age(age_us)) == read_us


@given(BEACONS, st.integers(0, 5000))
def test_echoes_shift_when_beacon_leaves_late(beacon: Beacon, late_us: int) -> None:
    body = bytearray(codec.encode(beacon))
    codec.shift_echoes(body, late_us)
    after = codec.decode(bytes(body))
    assert after.echoes == tuple(
        echo if echo.hold_us == NO_ECHO else echo._replace(hold_us=min(echo.hold_us + late_us, NO_ECHO))
        for echo in beacon.echoes
    )
    assert _rest(after) == _rest(beacon)


def _rest(beacon: Beacon) -> Sequence[object]:
    return beacon.hello, beacon.rows, beacon.requests, beacon.members, beacon.values, beacon.relays


@pytest.mark.parametrize("hops", [0, HOPS_MAX + 1, 255])
def test_relayed_value_with_invalid_hops_is_refused(hops: int) -> None:
    body = codec.encode(Beacon(relays=(RelayedValue(1, 2, 3, 0, hops, False, b"x"),)))
    with pytest.raises(WireError, match=f"a relayed value of {hops} hops: expected 1 to {HOPS_MAX}"):
        codec.decode(body)


@pytest.mark.parametrize(
    "beacon",
    [
        Beacon(echoes=(Echo(1, 2, 3, 256),)),
        Beacon(rows=(RouteRow(1, 2, -1),)),
        Beacon(rows=(RouteRow(1, 2, 3),) * 256),
        Beacon(relays=(RelayedValue(1, 2, 3, 4, 5, False, bytes(70_000)),)),
    ],
)
def test_beacon_that_fits_no_datagram_is_wire_error(beacon: Beacon) -> None:
    with pytest.raises(WireError, match="cannot be encoded"):
        codec.encode(beacon)


def test_a_lost_row_is_the_largest_metric() -> None:
    assert codec.decode(codec.encode(Beacon(rows=(RouteRow(1, 2, INFINITY),)))).rows[0].metric == 0xFFFF
