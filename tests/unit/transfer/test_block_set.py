"""Which blocks of a file are missing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.transport.transfer.block_set import BlockSet


def test_blocks_arrive_in_any_order_and_once() -> None:
    blocks = BlockSet(5)
    assert (blocks.missing, blocks.ranges()) == (5, ((0, 4),))
    assert blocks.add(2)
    assert not blocks.add(2), "a repeated block counts once"
    assert blocks.ranges() == ((0, 1), (3, 4))
    assert blocks.ranges(limit=1) == ((0, 1),)
    for number in (4, 0, 1, 3):
        blocks.add(number)
    assert (blocks.missing, blocks.ranges()) == (0, ())


def test_set_continues_after_restart_for_same_length() -> None:
    blocks = BlockSet(4)
    blocks.add(1)
    assert BlockSet(4, bytes(blocks)).ranges() == ((0, 0), (2, 3))
    assert BlockSet(3, bytes(blocks)).missing == 3
    blocks.clear()
    assert (blocks.missing, len(blocks)) == (4, 4)


def test_an_empty_file_has_no_blocks() -> None:
    assert (len(BlockSet(0)), BlockSet(0).missing, BlockSet(0).ranges()) == (0, 0, ())


@given(st.integers(1, 60), st.sets(st.integers(0, 59)))
def test_ranges_name_exactly_the_missing_blocks(count: int, arrived: set[int]) -> None:
    blocks = BlockSet(count)
    for number in arrived & set(range(count)):
        blocks.add(number)
    named = [number for first, last in blocks.ranges() for number in range(first, last + 1)]
    assert named == sorted(set(range(count)) - arrived)
    assert blocks.missing == len(named)


def test_block_that_is_not_of_file_is_error() -> None:
    with pytest.raises(IndexError):
        BlockSet(2).add(2)
