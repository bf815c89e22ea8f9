"""An MCAP file that is complete after each write: it has its end from its creation on, and grows before it.

The room between the data and the end of the file is one record, with an opcode that MCAP reserves for
applications and every reader skips. A batch is written into this room, behind its first 9 bytes; these
replace the head of the room last, in one write within one page: a reader, or a crash, finds all of the batch
or none.
"""

import os
from pathlib import Path
from typing import Final

from swarmware.errors import InvalidInput
from swarmware.recorder.scan import EMPTY_END, FILLER, RECORD, RESERVED, RESERVED_END

_PAGE: Final = 4096
"""A kill does not divide a write within one page. Source: Linux, `generic_perform_write`."""
_NEW: Final = ".new.mcap"
"""Suffix of a file whose end is not written yet; readers of the ring do not see it."""
_HEAD_BYTES: Final = RECORD.size


class GrowingFile:
    """Appends through a write buffer, which is kept until it is written completely.

    A failed write leaves no incomplete record: the same bytes are written to the same offset again.
    """

    def __init__(self, path: Path, reserved_bytes: int) -> None:
        """Open the file; it has its name after the first `flush`. `reserved_bytes`: room that it begins with.

        Raises: InvalidInput when there is one; OSError of the file system.
        """
        if path.exists():
            raise InvalidInput(f"{path}: exists; expected a new file, with one writer")
        self._path = path
        self._new: Path | None = path.with_suffix(_NEW)
        """Name of the file until it is complete."""
        self._reserved_bytes = reserved_bytes
        self._fd = os.open(self._new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        self._waiting = bytearray()
        self._on_disk = 0
        self._size = 0
        """Length of the file with its room, or 0 before its end is written."""

    def write(self, data: bytes) -> int:
        """Appends the data to the buffer: whole records."""
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Length of the data including the buffer, without the room behind it."""
        return self._on_disk + len(self._waiting)

    @property
    def pending_bytes(self) -> int:
        """Size of the buffer, in bytes."""
        return len(self._waiting)

    def flush(self) -> None:
        """Writes the buffer. Raises: OSError; the buffer is kept then."""
        if not self._waiting:
            return
        if self.tell() % _PAGE > _PAGE - _HEAD_BYTES:
            self._waiting += RECORD.pack(FILLER, 0)  # the next batch shall not begin across two pages
        self._reserve(self.tell() + _HEAD_BYTES)
        _replace_room(self._fd, bytes(self._waiting) + self._room(self.tell()), self._on_disk)
        if self._new is not None:
            self._new.rename(self._path)
            self._new = None
        self._on_disk += len(self._waiting)
        self._waiting.clear()

    def finish(self) -> None:
        """Writes the buffer, which ends the file, and removes the room. Raises: OSError; then as `flush`."""
        _replace_room(self._fd, bytes(self._waiting), self._on_disk)
        os.ftruncate(self._fd, self.tell())
        self._size = self._on_disk = self.tell()
        self._waiting.clear()

    def _reserve(self, end: int) -> None:
        """Moves the end of the file, when there is no room before `end`."""
        if end + len(RESERVED_END) > self._size:
            size = -(-(end + self._reserved_bytes + len(RESERVED_END)) // _PAGE) * _PAGE
            # The new end first: a kill in between leaves a file whose end marks it as unfinished.
            _write(self._fd, memoryview(RESERVED_END), size - len(RESERVED_END))
            self._size = size
            if self._on_disk:
                # the batch is written over the former end, which this makes a part of the room
                _write(self._fd, memoryview(self._room(self._on_disk)), self._on_disk)

    def _room(self, at: int) -> bytes:
        """Head of the room that begins at this offset."""
        return RECORD.pack(RESERVED, self._size - len(EMPTY_END) - at - _HEAD_BYTES)

    def sync(self) -> None:
        """Waits until the written data survives a power failure."""
        os.fdatasync(self._fd)

    def close(self) -> None:
        """Closes the file; the buffer is discarded."""
        fd, self._fd = self._fd, -1  # the descriptor is released even when close fails
        new, self._new = self._new, None
        if fd >= 0:
            os.close(fd)
        if new is not None:
            new.unlink(missing_ok=True)


def end_at(path: Path, offset: int) -> None:
    """Ends a file that its writer has not ended, behind its last complete record.

    Raises: OSError of the file system; the file is as readable then as before.
    """
    fd = os.open(path, os.O_WRONLY | os.O_CLOEXEC)
    try:
        _replace_room(fd, EMPTY_END, offset)
        os.ftruncate(fd, offset + len(EMPTY_END))
    finally:
        os.close(fd)


def remove_unfinished(directory: Path) -> None:
    """Removes files that a crash left at their creation."""
    for path in directory.glob(f"*{_NEW}"):
        path.unlink()


def _replace_room(fd: int, data: bytes, at: int) -> None:
    """Writes the data over the head of the room; its first bytes last."""
    _write(fd, memoryview(data)[_HEAD_BYTES:], at + _HEAD_BYTES)
    _write(fd, memoryview(data)[:_HEAD_BYTES], at)


def _write(fd: int, data: memoryview, at: int) -> None:
    while data:
        count = os.pwrite(fd, data, at)
        data, at = data[count:], at + count
