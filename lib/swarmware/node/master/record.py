"""Content of `master.lock`: holder of the role, fencing number, and the process that requests the role."""

import os
import struct
import zlib
from pathlib import Path
from typing import Final, NamedTuple

from swarmware.transport.shm.lock import stands_at
from swarmware.transport.shm.shared_file import open_cleared

_RECORD: Final = struct.Struct("<QIQ48sI")
"""epoch, pid, start of the process in ticks, label, CRC-32 of the preceding bytes."""

_WANT: Final = struct.Struct("<IQ")
"""pid and start in ticks of the preferred process that waits, or zeros without one."""

_WANT_AT: Final = 128


class Holder(NamedTuple):
    """The process that holds the role, or held it last."""

    epoch: int
    """Fencing number: one more with each take-over, also over restarts of the node."""
    pid: int
    """pid of the holder, or 0 if it has released the role."""
    pid_start: int
    label: str


NO_HOLDER: Final = Holder(0, 0, 0, "")


class RecordFile:
    """The file whose descriptor is locked. It is not mapped: a truncation does not end a process."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fd = open_cleared(path, os.O_RDWR | os.O_CREAT)

    @property
    def stands(self) -> bool:
        """Whether this file is still at its path."""
        return stands_at(self.fd, self.path)

    def _read(self, size: int, offset: int) -> bytes:
        return os.pread(self.fd, size, offset).ljust(size, b"\0")

    def mark(self) -> bytes:
        """Bytes that change with each take-over and each release: cheap to compare."""
        return self._read(12, 0)

    def holder(self) -> Holder | None:
        """The holder of the role, or None while the record is being written."""
        data = self._read(_RECORD.size, 0)
        if not any(data):
            return NO_HOLDER
        epoch, pid, pid_start, label, crc = _RECORD.unpack(data)
        if crc != zlib.crc32(data[:-4]):
            return None
        return Holder(epoch, pid, pid_start, label.rstrip(b"\0").decode("utf-8", "replace"))

    def write_holder(self, holder: Holder) -> None:
        """Write the holder; only the process that has the lock may call it."""
        data = _RECORD.pack(holder.epoch, holder.pid, holder.pid_start, holder.label.encode()[:48], 0)
        os.pwrite(self.fd, data[:-4] + zlib.crc32(data[:-4]).to_bytes(4, "little"), 0)

    def requested_by(self) -> tuple[int, int]:
        """pid and start of the preferred process that waits for the role, or (0, 0) without one."""
        pid, pid_start = _WANT.unpack(self._read(_WANT.size, _WANT_AT))
        return pid, pid_start

    def request_leadership(self, pid: int, pid_start: int) -> None:
        """Write the request of a preferred process; (0, 0) withdraws it."""
        os.pwrite(self.fd, _WANT.pack(pid, pid_start), _WANT_AT)

    def close(self) -> None:
        """Closes the file, which drops its lock."""
        os.close(self.fd)
