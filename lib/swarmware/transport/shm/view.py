"""The view: one frame of a ring, read in place in shared memory."""

from types import TracebackType
from typing import Self
from zlib import crc32

from swarmware.transport.shm.fence import Fence
from swarmware.transport.shm.layout import SEED_MASK


class View:
    """A view of one frame: process `data`, then call `still_valid()`; if it is False, discard the result.

    `words`: BEFORE and AFTER of the slot. `crc`: None where the slots carry none.
    """

    __slots__ = ("_crc", "_fence", "_words", "data", "sequence")

    def __init__(self, data: memoryview, words: memoryview, sequence: int, crc: int | None) -> None:
        self.data = data
        """The bytes, read-only; they change when the writer reuses the slot."""
        self.sequence = sequence
        self._words = words
        self._crc = crc
        self._fence = Fence()

    def still_valid(self) -> bool:
        """Whether `data` has been the complete frame from the beginning until now."""
        if self._crc is not None and crc32(self.data, self.sequence & SEED_MASK) != self._crc:
            return False
        self._fence()
        return self._words[0] == self.sequence == self._words[1]

    def release(self) -> None:
        """Release the memory; `data` is invalid afterwards."""
        self.data.release()
        self._words.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()
