"""The blocks of a file that have arrived. Sans-io."""

from collections.abc import Iterator
from typing import Final

BLOCK_BYTES: Final = 16 * 1024
"""Bytes of a block, which takes 0.13 s at 1 Mbit/s."""
FILE_BYTES_MAX: Final = 4 * 1024**3
RANGES_MAX: Final = 256
"""Maximum ranges of missing blocks in one report; further ranges follow in later reports."""
_MISSING: Final = 0
_HELD: Final = 1


def block_count(size_bytes: int) -> int:
    """Number of blocks of a file of this size."""
    return -(-size_bytes // BLOCK_BYTES)


class BlockSet:
    """Blocks by number, each missing or held; one byte each, as a file keeps them."""

    def __init__(self, count: int, held: bytes = b"") -> None:
        """`held`: content of a former set; another length counts as nothing held."""
        self._marks = bytearray(held) if len(held) == count else bytearray(count)
        self._missing = self._marks.count(_MISSING)

    def __len__(self) -> int:
        """Number of blocks."""
        return len(self._marks)

    @property
    def missing(self) -> int:
        """Number of missing blocks."""
        return self._missing

    def add(self, number: int) -> bool:
        """Mark a block as held; returns False if it was held before."""
        if self._marks[number] != _MISSING:
            return False
        self._marks[number] = _HELD
        self._missing -= 1
        return True

    def clear(self) -> None:
        """All blocks are missing again."""
        self._marks = bytearray(len(self._marks))
        self._missing = len(self._marks)

    def ranges(self, limit: int = RANGES_MAX) -> tuple[tuple[int, int], ...]:
        """The first ranges of missing blocks: first and last number of each."""
        found: list[tuple[int, int]] = []
        for first, last in self._all_ranges():
            found.append((first, last))
            if len(found) == limit:
                break
        return tuple(found)

    def _all_ranges(self) -> Iterator[tuple[int, int]]:
        marks, at = self._marks, 0
        while (first := marks.find(_MISSING, at)) >= 0:
            after = marks.find(_HELD, first)
            at = len(marks) if after < 0 else after
            yield first, at - 1

    def __bytes__(self) -> bytes:
        """One byte for each block, as `held` takes them."""
        return bytes(self._marks)
