"""Packets of reliable links: every one survives encoding, and no bytes do harm."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.broker.core.frames.reliable.packet import (
    DELAY_UNIT_NS,
    HEAD_BYTES,
    RANGES_MAX,
    Acknowledgement,
    Packet,
    Piece,
    acknowledgement_bytes,
    decode,
    encode,
    piece_bytes,
)
from swarmware.errors import WireError

NUMBERS = st.integers(0, 0xFFFF_FFFF)


@st.composite
def acknowledgements(draw: st.DrawFn) -> Acknowledgement:
    low = draw(st.integers(200_000, 0xFFFF_FFFF))
    ranges: list[tuple[int, int]] = []
    for _ in range(draw(st.integers(1, RANGES_MAX))):
        first = max(0, low - draw(st.integers(0, 300)))
        ranges.append((first, low))
        low = first - 2 - draw(st.integers(0, 300))
        if low < 0:
            break
    return Acknowledgement(tuple(ranges), draw(st.integers(0, 60_000)) * DELAY_UNIT_NS)


@st.composite
def pieces(draw: st.DrawFn) -> Piece:
    data = draw(st.binary(min_size=1, max_size=200))
    offset, after = draw(st.integers(0, 5000)), draw(st.integers(0, 5000))
    return Piece(draw(NUMBERS), offset + len(data) + after, offset, data)


@given(
    st.builds(
        Packet,
        NUMBERS,
        NUMBERS,
        st.none() | acknowledgements(),
        st.lists(pieces(), max_size=4).map(tuple),
        st.booleans(),
    )
)
def test_a_packet_survives_its_encoding(packet: Packet) -> None:
    assert decode(encode(packet)) == packet


@given(acknowledgements(), st.lists(pieces(), max_size=3).map(tuple))
def test_sizes_that_fill_packet_are_encoded_ones(
    acknowledgement: Acknowledgement, some: tuple[Piece, ...]
) -> None:
    size = HEAD_BYTES + acknowledgement_bytes(acknowledgement) + sum(map(piece_bytes, some))
    assert len(encode(Packet(1, 0, acknowledgement, some))) == size


@given(st.binary(max_size=300))
def test_any_bytes_are_a_packet_or_refused(data: bytes) -> None:
    with contextlib.suppress(WireError):
        decode(data)


@given(
    st.builds(Packet, NUMBERS, NUMBERS, acknowledgements(), st.lists(pieces(), max_size=2).map(tuple)),
    st.data(),
)
def test_a_changed_packet_is_decoded_or_refused(packet: Packet, draw: st.DataObject) -> None:
    data = bytearray(encode(packet))
    data[draw.draw(st.integers(0, len(data) - 1))] ^= draw.draw(st.integers(1, 255))
    with contextlib.suppress(WireError):
        decode(bytes(data[: draw.draw(st.integers(0, len(data)))]))


def test_old_ranges_without_room_are_left_out() -> None:
    many = tuple((1000 - 4 * number, 1001 - 4 * number) for number in range(RANGES_MAX + 8))
    found = decode(encode(Packet(1, 0, Acknowledgement(many, 0)))).acknowledgement
    assert found is not None
    assert found.ranges == many[:RANGES_MAX]
    far = Acknowledgement(((500_000, 500_001), (1, 2)), 0)
    found = decode(encode(Packet(1, 0, far))).acknowledgement
    assert found is not None
    assert found.ranges == far.ranges[:1]


@pytest.mark.parametrize(
    ("element", "why"),
    [
        (b"\x09", "expected 1 to 4"),
        (b"\x03\x01\0\0\0\x05\0abc", "expected 5"),
        (b"\x03\x01\0\0\0\0\0", "not none"),
        (b"\x02\x01\0\0\0\x02\0\0\0\x01\0\0\0\x02\0ab", "of 2"),
        (b"\x02\x01\0\0\0\xff\xff\xff\xff\x01\0\0\0\x02\0ab", "of 4294967295"),
        (b"\x01\x01\0\0\0\0\0\0\x05\0", "below packet 0"),
        (b"\x01\x01\0", "ends within an element"),
    ],
)
def test_what_is_wrong_is_said(element: bytes, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode(bytes(HEAD_BYTES) + element)
