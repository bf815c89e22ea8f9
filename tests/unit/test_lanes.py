"""Vectors of small integers in one large one: against arithmetic on single elements."""

import struct
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.model.lanes import BYTE, WORD, differences, sums, unzigzag, zigzag

WORDS = st.lists(st.integers(0, 0xFFFF), max_size=200)
OCTETS = st.lists(st.integers(0, 0xFF), max_size=200)


def words(elements: Sequence[int]) -> bytes:
    return struct.pack(f"<{len(elements)}H", *elements)


@given(WORDS)
def test_differences_of_words_are_those_of_their_elements(elements: list[int]) -> None:
    expected = [(now - before) & 0xFFFF for before, now in zip([0, *elements], elements, strict=False)]
    assert differences(words(elements), WORD) == words(expected)


@given(OCTETS)
def test_differences_of_bytes_are_those_of_their_elements(elements: list[int]) -> None:
    expected = [(now - before) & 0xFF for before, now in zip([0, *elements], elements, strict=False)]
    assert differences(bytes(elements), BYTE) == bytes(expected)


@given(OCTETS)
def test_sums_of_bytes_are_inverse_of_their_differences(elements: list[int]) -> None:
    assert sums(differences(bytes(elements), BYTE), BYTE) == bytes(elements)


@given(WORDS)
def test_sums_of_words_are_inverse_of_their_differences(elements: list[int]) -> None:
    assert sums(differences(words(elements), WORD), WORD) == words(elements)


@pytest.mark.parametrize(
    ("signed", "expected"), [(0, 0), (-1, 1), (1, 2), (-2, 3), (2, 4), (127, 254), (-128, 255)]
)
def test_zigzag_makes_small_magnitudes_small(signed: int, expected: int) -> None:
    assert zigzag(struct.pack("b", signed), BYTE) == bytes([expected])
    assert zigzag(struct.pack("<h", signed), WORD) == struct.pack("<H", expected)


@given(st.lists(st.integers(-32768, 32767), max_size=200))
def test_zigzag_of_words_is_reverted(elements: list[int]) -> None:
    data = struct.pack(f"<{len(elements)}h", *elements)
    coded = zigzag(data, WORD)
    assert coded == words([2 * one if one >= 0 else -2 * one - 1 for one in elements])
    assert unzigzag(coded, WORD) == data


@given(st.binary(max_size=200))
def test_zigzag_of_bytes_is_reverted(data: bytes) -> None:
    assert unzigzag(zigzag(data, BYTE), BYTE) == data
