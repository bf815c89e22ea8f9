"""The table of readers: a small file beside a ring that names the doorbells of those who read it.

Readers write it under its lock, the writer only looks at it: one word, the generation, tells it of a change.
It may be there before the ring: so a reader waits for a writer to come.
"""

import contextlib
import mmap
import os
from collections.abc import Iterator
from pathlib import Path

from swarmware.errors import Conflict, NotFound, WireError
from swarmware.shm.doorbell import NAME
from swarmware.shm.lock import is_regular, lock_within, stands_at
from swarmware.shm.ringfile import file_errors

MAGIC = int.from_bytes(b"SWBELLS\0", "little")
VERSION = 1
FILE_BYTES = 4096
MODE = 0o660
"""The one file in shared memory that readers write: who may read the ring may be woken by it."""
ENTRIES = 64

_MAGIC, _VERSION, _GENERATION, _GONE = range(4)
_HEADER_BYTES, _NAME_BYTES = 64, 48
_ENTRY_BYTES = 8 + _NAME_BYTES
"""An entry: the length of the name as a word, 0 when free; then the name."""
_STARTS = tuple(_HEADER_BYTES + i * _ENTRY_BYTES for i in range(ENTRIES))


class ReadersTable:
    """A mapped table. Changing it needs the lock, reading does not.

    A name is written before its length, the generation after both: whoever reads a half-written table sees
    the generation change later, and reads again.
    """

    def __init__(self, fd: int, path: Path) -> None:
        """Raises: WireError when the file is no table, or not complete yet."""
        if not is_regular(fd) or os.fstat(fd).st_size != FILE_BYTES:
            raise WireError(f"{path}: not a table of readers, expected a file of {FILE_BYTES} bytes")
        self._map = mmap.mmap(fd, FILE_BYTES, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE)
        self._words = memoryview(self._map).cast("Q")
        if self._words[_MAGIC] != MAGIC or self._words[_VERSION] != VERSION:
            self.close()
            raise WireError(
                f"{path}: not a table of readers of layout {VERSION}, expected SWBELLS at its start"
            )

    @property
    def generation(self) -> int:
        """Another number after every change."""
        return self._words[_GENERATION]

    @property
    def gone(self) -> bool:
        """Whether the file has left its path, or is about to."""
        return self._words[_GONE] != 0

    def names(self) -> tuple[str, ...]:
        """The names in the table; what cannot be a name is passed over."""
        found = []
        for start in _STARTS:
            length = self._words[start // 8]
            if 0 < length < _NAME_BYTES:
                name = self._map[start + 8 : start + 8 + length].decode("ascii", "replace")
                if NAME.match(name):
                    found.append(name)
        return tuple(found)

    def put(self, name: str) -> bool:
        """Take a free entry; False when there is none."""
        for start in _STARTS:
            if not 0 < self._words[start // 8] < _NAME_BYTES:
                self._map[start + 8 : start + _ENTRY_BYTES] = name.encode("ascii").ljust(_NAME_BYTES, b"\0")
                self._words[start // 8] = len(name)
                self._changed()
                return True
        return False

    def clear(self, name: str) -> None:
        """Free the entry of a name, if it has one."""
        for start in _STARTS:
            length = self._words[start // 8]
            if length == len(name) and self._map[start + 8 : start + 8 + length] == name.encode("ascii"):
                self._words[start // 8] = 0
                self._changed()

    def retire(self) -> None:
        """Tell all who have it mapped that the file is leaving its path."""
        self._words[_GONE] = 1
        self._changed()

    def revive(self) -> None:
        """Take back what a reaper said that was killed before it removed the file."""
        if self.gone:
            self._words[_GONE] = 0
            self._changed()

    def _changed(self) -> None:
        self._words[_GENERATION] = (self._words[_GENERATION] + 1) % (1 << 64)

    def close(self) -> None:
        self._words.release()
        self._map.close()


def open_table(path: Path) -> ReadersTable | None:
    """The complete table at the path, without its lock; None when it is missing, unfinished or leaving."""
    try:
        fd = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        table = ReadersTable(fd, path)
    except WireError:
        return None
    finally:
        os.close(fd)
    if table.gone:
        table.close()
        return None
    return table


@contextlib.contextmanager
def locked_table(path: Path, timeout_s: float, *, create: bool) -> Iterator[ReadersTable]:
    """The table at the path for changing; unmapped at the end.

    Raises: Conflict when it stays locked, NotFound when it is missing and not to be made, WireError.
    """
    fd = _lock(path, timeout_s, create=create)
    try:
        table = ReadersTable(fd, path)
        try:
            table.revive()
            yield table
        finally:
            table.close()
    finally:
        os.close(fd)


def _lock(path: Path, timeout_s: float, *, create: bool) -> int:
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    while True:
        try:
            with file_errors(path):
                if create:
                    path.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
                fd = os.open(path, flags | os.O_CREAT if create else flags, MODE)
        except NotFound:
            if create:
                continue  # the folder was removed behind our back
            raise
        try:
            if not lock_within(fd, timeout_s):
                raise Conflict(f"{path}: locked for more than {timeout_s} s, expected a moment")
            if stands_at(fd, path):
                with file_errors(path):
                    _complete(fd)
                kept, fd = fd, -1
                return kept
        finally:
            if fd >= 0:
                os.close(fd)


def _complete(fd: int) -> None:
    """Make an empty file, or one whose maker was killed, a table; leave any other as it is."""
    if is_regular(fd) and os.fstat(fd).st_size <= FILE_BYTES and not any(os.pread(fd, 8, 0)):
        os.posix_fallocate(fd, 0, FILE_BYTES)
        os.fchmod(fd, MODE)
        os.pwrite(fd, VERSION.to_bytes(8, "little"), _VERSION * 8)
        os.pwrite(fd, MAGIC.to_bytes(8, "little"), _MAGIC * 8)  # last: from here on it is a table
