"""The frame header of share/doc/protocol.md, section 2, byte by byte."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import WireError
from swarmware.model import frame as wire
from swarmware.model.frame import Codec, Flag, Frame, FrameKind

U32 = st.integers(0, 2**32 - 1)
FRAMES = st.builds(
    Frame,
    kind=st.sampled_from(FrameKind),
    data_id=U32,
    sender_hw=U32,
    sender_app=U32,
    receiver_hw=U32,
    receiver_app=U32,
    sequence=U32,
    stamp_ns=st.integers(-(2**63), 2**63 - 1),
    echo_tx_us=U32,
    echo_rx_us=U32,
    flags=st.integers(0, 15),
    codec=st.sampled_from(Codec),
    hops_left=st.integers(0, 255),
    extension=st.binary(max_size=255),
    payload=st.binary(max_size=300),
)


@given(FRAMES)
def test_what_was_encoded_is_decoded_again(frame: Frame) -> None:
    data = wire.encode(frame)
    assert len(data) == wire.HEADER_BYTES + len(frame.extension) + len(frame.payload)
    assert wire.decode(data) == frame


@given(st.binary(max_size=200))
def test_any_bytes_give_frame_or_wire_error(data: bytes) -> None:
    with contextlib.suppress(WireError):
        wire.decode(data)


@given(FRAMES, st.integers(0, 47), st.integers(0, 255))
def test_damaged_header_gives_frame_or_wire_error(frame: Frame, position: int, value: int) -> None:
    data = bytearray(wire.encode(frame))
    data[position] = value
    with contextlib.suppress(WireError):
        assert isinstance(wire.decode(bytes(data)), Frame)


def test_every_field_stands_where_the_design_says() -> None:
    data = wire.encode(
        Frame(
            FrameKind.REQUEST,
            0x01020304,
            0x11,
            0x22,
            0x33,
            0x44,
            0x55,
            0x66,
            0x77,
            0x88,
            Flag.WANTS_ACK,
            Codec.ZSTD,
            5,
            b"ex",
            b"pay",
        )
    )
    assert data[0:2] == b"SW"
    assert data[2] == wire.VERSION
    assert data[3] == FrameKind.REQUEST
    assert int.from_bytes(data[4:6], "little") == Flag.WANTS_ACK | Codec.ZSTD << 8
    assert (data[6], data[7]) == (5, 2)
    words = [int.from_bytes(data[i : i + 4], "little") for i in range(8, 32, 4)]
    assert words == [0x01020304, 0x11, 0x22, 0x33, 0x44, 0x55]
    assert int.from_bytes(data[32:40], "little", signed=True) == 0x66
    assert int.from_bytes(data[40:44], "little") == 0x77
    assert int.from_bytes(data[44:48], "little") == 0x88
    assert data[48:] == b"expay"


def test_adjacent_versions_are_understood_and_others_are_not() -> None:
    data = bytearray(wire.encode(Frame(FrameKind.BOARD, 1)))
    for version, fits in [(wire.VERSION - 1, True), (wire.VERSION + 1, True), (wire.VERSION + 2, False)]:
        data[2] = version
        if fits:
            assert wire.decode(bytes(data)).kind is FrameKind.BOARD
        else:
            with pytest.raises(WireError, match="version"):
                wire.decode(bytes(data))


def test_a_view_is_decoded_without_copying_the_payload() -> None:
    data = wire.encode(Frame(FrameKind.STREAM, 1, payload=b"x" * 100))
    view = memoryview(data)
    payload = wire.decode(view).payload
    assert isinstance(payload, memoryview)
    assert payload.obj is data


@pytest.mark.parametrize("flags", [0, 2, 4, 6, Flag.URGENT, Flag.WANTS_ACK | Flag.URGENT])
def test_flags_of_frame_are_readable_as_properties(flags: int) -> None:
    frame = Frame(FrameKind.MESSAGE, 1, flags=flags)
    assert (frame.is_urgent, frame.wants_ack) == (bool(flags & Flag.URGENT), bool(flags & Flag.WANTS_ACK))
