"""A file that is being received: its blocks beside the place of the whole one, until they are complete."""

import contextlib
import os
import stat
from pathlib import Path
from typing import Final

from swarmware.errors import InvalidInput, OutOfRange
from swarmware.footprint.blake2b import blake2b
from swarmware.transport.transfer.block_set import BLOCK_BYTES, BlockSet, block_count

DIGEST_BYTES: Final = 32
_READ_BYTES: Final = 1024 * 1024
_FLAGS: Final = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW


def regular_file_size(path: Path, limit_bytes: int) -> int:
    """Size of a regular file in bytes, before anything is read of it.

    A FIFO or a device has no end, and a sparse file may be larger than any disk.
    Raises: OutOfRange above the limit, InvalidInput for any other kind of file, OSError.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise InvalidInput(f"{path}: not a regular file; expected a file, not a folder, FIFO or device")
    if found.st_size > limit_bytes:
        raise OutOfRange(f"{path}: {found.st_size} bytes; expected at most {limit_bytes}")
    return found.st_size


def digest_of(path: Path) -> bytes:
    """BLAKE2b-256 of the content of a file. Raises: OSError."""
    content = blake2b(digest_size=DIGEST_BYTES)
    with path.open("rb") as file:
        while part := file.read(_READ_BYTES):
            content.update(part)
    return content.digest()


class PartialFile:
    """Blocks of one content, by its digest; what arrived is kept over restarts, in two hidden files."""

    def __init__(self, folder: Path, digest: bytes, size_bytes: int) -> None:
        """Raises: OutOfRange when the disk has no room for the file; OSError."""
        self.digest = digest
        self.size_bytes = size_bytes
        self._path = folder / f".{digest.hex()}.part"
        self._marks = folder / f".{digest.hex()}.have"
        self._descriptor = os.open(self._path, _FLAGS, 0o640)
        try:
            self._marks_descriptor = os.open(self._marks, _FLAGS, 0o640)
            try:
                self.blocks = self._reserve()
            except BaseException:
                os.close(self._marks_descriptor)
                raise
        except BaseException:
            os.close(self._descriptor)
            raise

    def _reserve(self) -> BlockSet:
        # another size: a kill has interrupted the reservation, and no block is valid
        is_former = os.fstat(self._descriptor).st_size == self.size_bytes
        try:
            # the kernel refuses to reserve an empty range
            if self.size_bytes:
                # a full disk shows before the transfer, not after an hour of it
                os.posix_fallocate(self._descriptor, 0, self.size_bytes)
            count = block_count(self.size_bytes)
            blocks = BlockSet(count, os.pread(self._marks_descriptor, count, 0) if is_former else b"")
            os.pwrite(self._marks_descriptor, bytes(blocks), 0)
            os.ftruncate(self._marks_descriptor, count)
        except OSError as error:
            self.discard()
            free = os.statvfs(self._path.parent)
            raise OutOfRange(
                f"no room for {self.size_bytes} bytes in {self._path.parent}: {error.strerror}; "
                f"{free.f_bavail * free.f_frsize} bytes are free"
            ) from error
        return blocks

    def write(self, offset: int, data: bytes) -> None:
        """Take a block.

        Raises: InvalidInput for bytes that are not a block of this file; OSError.
        """
        number, rest = divmod(offset, BLOCK_BYTES)
        expected = min(BLOCK_BYTES, self.size_bytes - offset)
        # offset and length come from another platform
        if rest or not 0 <= number < len(self.blocks) or len(data) != expected:
            raise InvalidInput(
                f"{len(data)} bytes at {offset} of {self.size_bytes}: expected a block of {BLOCK_BYTES}"
            )
        # the data before the mark: a kill in between repeats the block
        os.pwrite(self._descriptor, data, offset)
        if self.blocks.add(number):
            os.pwrite(self._marks_descriptor, b"\x01", number)

    def finish(self, target: Path) -> None:
        """Put the complete file in its place, at once and durably.

        Raises: InvalidInput when its content has another digest: then all blocks are missing again; OSError.
        """
        if digest_of(self._path) != self.digest:
            self.blocks.clear()
            os.pwrite(self._marks_descriptor, bytes(self.blocks), 0)
            raise InvalidInput(
                f"{target.name}: the content does not have its digest; expected {self.digest.hex()}"
            )
        # the content before the name, else a power failure leaves an empty file under it
        os.fsync(self._descriptor)
        self._path.replace(target)
        self._marks.unlink(missing_ok=True)
        folder = os.open(target.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            # the name is an entry of the folder, which has to reach the disk as well
            os.fsync(folder)
        finally:
            os.close(folder)

    def discard(self) -> None:
        """Remove what has arrived."""
        for path in (self._path, self._marks):
            with contextlib.suppress(OSError):  # `remove_old` tries again after the next start
                path.unlink()

    def close(self) -> None:
        """Close the files; what has arrived stays."""
        os.close(self._descriptor)
        os.close(self._marks_descriptor)
