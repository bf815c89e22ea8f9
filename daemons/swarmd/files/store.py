"""The folder of the files: complete files by name, incomplete files with a hidden name beside them."""

import os
import stat
from pathlib import Path
from typing import Final

from swarmware.errors import NotFound
from swarmware.transport.transfer.block_set import BLOCK_BYTES
from swarmware.transport.transfer.partial_file import PartialFile, digest_of
from swarmware.types.file import FileEntry, FileOffer

_READ: Final = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW
"""Flags that refuse a symbolic link, which could serve a file outside of the folder."""
DIGESTS_MAX: Final = 256


class FileStore:
    """Complete files of one folder, and the open incomplete files."""

    def __init__(self, folder: Path) -> None:
        """Raises: OSError when the folder is missing and cannot be created."""
        folder.mkdir(mode=0o750, parents=True, exist_ok=True)
        self.folder = folder
        self._parts: dict[bytes, PartialFile] = {}
        self._digests: dict[tuple[str, int, int, int], bytes] = {}
        """Digests by name, inode, modification time and size."""

    def remove_old(self, before_s: float) -> int:
        """Removes incomplete files without a new block since `before_s`; returns their number."""
        removed = 0
        for path in self.folder.glob(".*.part"):
            # lstat: a link may point to a file outside of the folder
            if path.lstat().st_mtime < before_s:
                path.unlink(missing_ok=True)
                path.with_suffix(".have").unlink(missing_ok=True)
                removed += 1
        return removed

    def entries(self) -> list[FileEntry]:
        """All complete files by name, without digests."""
        found: list[FileEntry] = []
        for path in sorted(self.folder.iterdir()):
            status = path.lstat()
            if stat.S_ISREG(status.st_mode) and not path.name.startswith("."):
                found.append(FileEntry(path.name, status.st_size, status.st_mtime_ns))
        return found

    def stored_bytes(self) -> int:
        """Total size of all complete files."""
        return sum(entry.size_bytes for entry in self.entries())

    def entry(self, name: str) -> FileEntry:
        """One file with its digest; a changed file is read to compute the digest. Raises: NotFound."""
        path = self.folder / name
        try:
            status = path.lstat()
        except OSError as error:
            raise NotFound(f"file {name!r}: {error.strerror}; `swarmctl file ls` lists the files") from error
        if not stat.S_ISREG(status.st_mode):
            raise NotFound(f"file {name!r}: not a file")
        key = (name, status.st_ino, status.st_mtime_ns, status.st_size)
        digest = self._digests.get(key)
        # reading a large file takes seconds, so its digest is cached until the file changes
        if digest is None:
            digest = digest_of(path)
            if len(self._digests) >= DIGESTS_MAX:
                # old versions of files would accumulate
                self._digests.clear()
            self._digests[key] = digest
        return FileEntry(name, status.st_size, status.st_mtime_ns, digest)

    def has_content(self, name: str, digest: bytes) -> bool:
        """True if a file of this name exists with this content."""
        try:
            return self.entry(name).digest == digest
        except NotFound:
            return False

    def read(self, name: str, offset: int) -> bytes:
        """A block of a file. Raises: NotFound."""
        try:
            descriptor = os.open(self.folder / name, _READ)
        except OSError as error:
            raise NotFound(f"file {name!r}: {error.strerror}") from error
        try:
            return os.pread(descriptor, BLOCK_BYTES, offset)
        finally:
            os.close(descriptor)

    def part(self, offer: FileOffer) -> PartialFile:
        """The incomplete file of an offer, with the blocks that arrived before.

        Raises: OutOfRange when the disk has no room; OSError.
        """
        part = self._parts.get(offer.digest)
        # the same digest with another size is an invalid offer of either; the newest counts
        if part is None or part.size_bytes != offer.size_bytes:
            self.drop(offer.digest)
            part = self._parts[offer.digest] = PartialFile(self.folder, offer.digest, offer.size_bytes)
        return part

    def finish(self, offer: FileOffer) -> None:
        """Moves a complete file to its name. Raises: InvalidInput if its digest differs; OSError."""
        self._parts[offer.digest].finish(self.folder / offer.name)
        self._parts.pop(offer.digest).close()

    def drop(self, digest: bytes, *, discard: bool = False) -> None:
        """Closes an incomplete file, and removes its blocks if `discard` is set."""
        part = self._parts.pop(digest, None)
        if part is not None:
            if discard:
                part.discard()
            part.close()

    def close(self) -> None:
        """Closes all incomplete files; their blocks stay."""
        for digest in list(self._parts):
            self.drop(digest)
