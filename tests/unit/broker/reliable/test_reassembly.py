"""Messages from pieces: whole, once, in any order, within limits."""

from random import Random

import pytest

from swarmd.broker.core.frames.reliable.packet import Piece
from swarmd.broker.core.frames.reliable.reassembly import BYTES_MAX, SPAN_MAX, Reassembly
from swarmware.errors import WireError

TEXT = Random(1).randbytes(5000)


def cut(data: bytes, size: int, number: int = 0) -> list[Piece]:
    return [Piece(number, len(data), at, data[at : at + size]) for at in range(0, len(data), size)]


@pytest.mark.parametrize("seed", range(10))
def test_pieces_in_any_order_give_message_once(seed: int) -> None:
    parts = cut(TEXT, 700) * 2
    Random(seed).shuffle(parts)
    incoming = Reassembly()
    found = [whole for part in parts if (whole := incoming.on_piece(part)) is not None]
    assert found == [TEXT]


def test_a_message_in_one_piece_is_delivered_once() -> None:
    incoming = Reassembly()
    assert incoming.on_piece(Piece(4, 2, 0, b"ab")) == b"ab"
    assert incoming.on_piece(Piece(4, 2, 0, b"ab")) is None


def test_nothing_below_floor_is_delivered_or_kept() -> None:
    incoming = Reassembly()
    incoming.on_piece(Piece(0, 1, 0, b"a"))
    for part in cut(TEXT, 700, number=1)[:3]:
        incoming.on_piece(part)
    incoming.on_floor(2)
    assert incoming.on_piece(Piece(0, 1, 0, b"a")) is None
    assert all(incoming.on_piece(part) is None for part in cut(TEXT, 700, number=1))
    assert incoming.has_room((Piece(3, BYTES_MAX, 0, b"x"),)), "the incomplete message takes no room any more"
    incoming.on_floor(1)
    assert incoming.on_piece(Piece(1, 1, 0, b"a")) is None, "a floor never falls"


def test_a_floor_far_ahead_forgets_all_before_it() -> None:
    incoming = Reassembly()
    incoming.on_piece(Piece(0, 1, 0, b"a"))
    incoming.on_floor(10 * SPAN_MAX)
    assert incoming.on_piece(Piece(10 * SPAN_MAX, 1, 0, b"z")) == b"z"


def test_a_message_far_after_the_floor_is_refused() -> None:
    with pytest.raises(WireError, match="after the incomplete one"):
        Reassembly().on_piece(Piece(SPAN_MAX + 1, 1, 0, b"a"))


@pytest.mark.parametrize(
    "second",
    [Piece(0, 99, 3, b"abc"), Piece(0, 10, 0, b"abcd"), Piece(0, 10, 2, b"abcdefgh")],
    ids=["another length", "another piece there", "an overlap"],
)
def test_mismatched_pieces_are_refused(second: Piece) -> None:
    incoming = Reassembly()
    assert incoming.on_piece(Piece(0, 10, 0, b"abc")) is None
    with pytest.raises(WireError, match=r"fit each other|overlap"):
        incoming.on_piece(second)


def test_incomplete_messages_are_limited_and_begun_continue() -> None:
    incoming = Reassembly()
    large = BYTES_MAX // 2
    for number in range(2):
        part = Piece(number, large, 0, b"x")
        assert incoming.has_room((part,))
        incoming.on_piece(part)
    assert not incoming.has_room((Piece(2, 10, 0, b"x"),))
    assert incoming.has_room((Piece(1, large, 5, b"x"), Piece(3, 1, 0, b"y")))
