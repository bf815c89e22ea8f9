"""What `master.lock` says: who holds the role, under which fencing number, and who wants it."""

import mmap
import os
import struct
import zlib
from pathlib import Path
from typing import Final, NamedTuple

_RECORD: Final = struct.Struct("<QIQ48sI")
"""epoch, pid, start of the process in ticks, label, CRC-32 of what stands before it."""

_WANT: Final = struct.Struct("<IQ")
"""pid and start in ticks of the preferred process that waits; 0: nobody."""

_WANT_AT: Final = 128
FILE_BYTES: Final = 256


class Holder(NamedTuple):
    """The process that holds the role, or held it last."""

    epoch: int
    """Fencing number: one more with each take-over, also over restarts of the node."""
    pid: int
    """0: it gave the role back."""
    pid_start: int
    label: str


NOBODY: Final = Holder(0, 0, 0, "")


class RecordFile:
    """The mapped file; `fd` is what is locked."""

    def __init__(self, path: Path) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        if os.fstat(self.fd).st_size < FILE_BYTES:
            os.ftruncate(self.fd, FILE_BYTES)
        self._map = mmap.mmap(self.fd, FILE_BYTES)

    def mark(self) -> bytes:
        """Bytes that are others with each take-over and with each release: cheap to compare."""
        return self._map[:12]

    def holder(self) -> Holder | None:
        """Who holds the role; None while it is being written."""
        data = self._map[: _RECORD.size]
        if not any(data):
            return NOBODY
        epoch, pid, pid_start, label, crc = _RECORD.unpack(data)
        if crc != zlib.crc32(data[:-4]):
            return None
        return Holder(epoch, pid, pid_start, label.rstrip(b"\0").decode("utf-8", "replace"))

    def write_holder(self, holder: Holder) -> None:
        """Only for the process that has the lock."""
        data = _RECORD.pack(holder.epoch, holder.pid, holder.pid_start, holder.label.encode()[:48], 0)
        self._map[: _RECORD.size] = data[:-4] + zlib.crc32(data[:-4]).to_bytes(4, "little")

    def wanted_by(self) -> tuple[int, int]:
        """pid and start of the preferred process that waits for the role; (0, 0): none."""
        pid, pid_start = _WANT.unpack_from(self._map, _WANT_AT)
        return pid, pid_start

    def write_want(self, pid: int, pid_start: int) -> None:
        """Ask for the role, or (0, 0) ask no more."""
        _WANT.pack_into(self._map, _WANT_AT, pid, pid_start)

    def close(self) -> None:
        """Closes the file, which drops its lock."""
        self._map.close()
        os.close(self.fd)
