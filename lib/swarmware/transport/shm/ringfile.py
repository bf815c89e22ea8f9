"""The ring file: claimed by one writer, replaced, removed; always complete at its path.

Three rules make `kill -9` harmless at every instruction. A file is created and filled under `<name>.new`,
whose lock is held, and renamed when complete. A process that changes a file holds its lock and has checked
that it is at its path. Before a file is removed from its path its header gets MOVED, so that readers reopen
the path.
"""

import contextlib
import errno
import mmap
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

from swarmware.errors import Denied, NotFound, SwarmError, WireError
from swarmware.transport.shm import layout
from swarmware.transport.shm.access import make_folder, share
from swarmware.transport.shm.layout import Geometry, RingBusy, RingFull
from swarmware.transport.shm.lock import lock_within, stands_at, try_lock
from swarmware.transport.shm.owner import Owner
from swarmware.transport.shm.shared_file import discard, open_cleared, open_shared

LOCK_WAIT_S = 0.25
"""Wait for a lock without a living owner in the header: others probe it for microseconds."""
ATTEMPTS = 100
"""Maximum attempts; each fails only if another process made or removed the file meanwhile."""


@contextlib.contextmanager
def file_errors(path: Path) -> Iterator[None]:
    """Convert errors of the operating system to errors that name the path."""
    try:
        yield
    except FileNotFoundError as error:
        raise NotFound(f"{path}: no such file") from error
    except PermissionError as error:
        raise Denied(f"{path}: no permission") from error
    except OSError as error:
        if error.errno in {errno.ENOSPC, errno.EDQUOT}:
            raise RingFull(f"shared memory is full: {path}, {_usage(path)}") from error
        if error.errno == errno.EFBIG:
            raise RingFull(
                f"{path}: larger than files may be; expected a higher limit (ulimit -f)"
            ) from error
        if error.errno in {errno.ELOOP, errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENXIO}:
            raise WireError(f"{path}: not a regular file in a folder") from error
        raise


def _usage(path: Path) -> str:
    """Used and total bytes of the file system of a ring."""
    found = os.statvfs(path.parent)
    total = found.f_blocks * found.f_frsize
    return f"{total - found.f_bavail * found.f_frsize} of {total} bytes of its file system are used"


def open_reading(path: Path) -> int:
    """Descriptor for reading; a FIFO or a link at the path is refused."""
    with file_errors(path):
        return open_shared(path)


def absent(path: str) -> bool:
    """Whether there is nothing at a path, for readers that wait for a writer.

    `open_reading` handles all other cases, but takes five times as long to find nothing.
    """
    try:
        os.lstat(path)  # no Path object
    except FileNotFoundError:
        return True
    except OSError:  # `open_reading` finds out which and raises
        return False
    return False


EpochPosition = tuple[int, int]
"""Epoch and newest sequence of a ring, from which its replacement continues."""


def claim(
    path: Path, geometry: Geometry, mode: int, resume: EpochPosition | None = None
) -> tuple[mmap.mmap, bool]:
    """Become the only writer of the ring at the path; returns its map, and True if it continues an old ring.

    The lock is held by the map. `resume`: position from which the writer of a damaged ring continues.
    Raises: RingBusy, RingFull, Denied.
    """
    geometry.check(path)
    with file_errors(path):
        for _ in range(ATTEMPTS):
            make_folder(path.parent, path.parent.parent)
            old_fd = _lock_existing(path)
            try:
                ring = None
                if old_fd is not None and resume is None:
                    ring = _take_over(old_fd, path, geometry)
                if ring is not None:
                    return ring, True
                ring = _make(path, geometry, mode, old_fd, resume)
                if ring is not None:
                    return ring, False
            finally:
                if old_fd is not None:
                    os.close(old_fd)  # the map keeps the open file, and so the lock, by its own descriptor
    raise RingBusy(f"{path}: other processes keep making and removing it")


def _lock_existing(path: Path) -> int | None:
    """Locked descriptor of the file at the path, or None without a file."""
    while True:
        try:
            fd = open_shared(path, os.O_RDWR)
        except FileNotFoundError:
            return None
        except (WireError, PermissionError):
            # not a regular file, or a group member's: the owner of the folder may remove both
            if not discard(path):
                raise
            continue
        try:
            if not try_lock(fd):
                # A living owner keeps its ring; any other holder of the lock releases it soon.
                owner = _owner_of(fd)
                if owner.alive() or not lock_within(fd, LOCK_WAIT_S):
                    raise RingBusy(_busy_text(path, _owner_of(fd)))
            if stands_at(fd, path):
                kept, fd = fd, -1
                return kept
        finally:
            if fd >= 0:
                os.close(fd)


def _busy_text(path: Path, owner: Owner) -> str:
    who = f"process {owner.pid}" if owner.alive() else "a process that cannot be seen from here"
    return f"{path}: {who} writes this ring, expected one writer only"


def _owner_of(fd: int) -> Owner:
    header = os.pread(fd, layout.HEADER_BYTES, 0)
    if len(header) < layout.HEADER_BYTES:
        return Owner(0, 0, 0)
    return layout.read_owner(memoryview(header).cast("Q"))


def _map(fd: int, file_bytes: int) -> mmap.mmap:
    return mmap.mmap(fd, file_bytes, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE)


def _take_over(fd: int, path: Path, geometry: Geometry) -> mmap.mmap | None:
    """Continue a ring whose owner has ended, or return None if it has another layout or is damaged."""
    file_bytes = os.fstat(fd).st_size
    if file_bytes != geometry.file_bytes:
        return None
    ring = _map(fd, file_bytes)
    words = memoryview(ring).cast("Q")
    try:
        fits = layout.read_header(words, file_bytes, path) == geometry and _newest_complete(
            ring, words, geometry
        )
        if fits:
            layout.write_owner(words, Owner.current())
            words[layout.W_MOVED] = (
                0  # set by a writer or a reaper that was killed before the rename or unlink
            )
    except WireError:
        fits = False
    finally:
        words.release()
    if fits:
        return ring
    ring.close()
    return None


def _newest_complete(ring: mmap.mmap, words: memoryview, geometry: Geometry) -> bool:
    """Whether the newest frame matches the index: false only if the file was damaged from outside."""
    newest, first = words[layout.W_NEWEST], words[layout.W_FIRST]
    if newest == first:
        return True
    base = layout.HEADER_BYTES + newest % geometry.slots * geometry.stride
    slot = base // 8
    meta = words[slot + layout.S_META]
    length = meta & layout.LENGTH_MASK
    if newest < first or words[slot + layout.S_AFTER] != newest or length > geometry.slot_bytes:
        return False
    start = base + layout.SLOT_HEADER_BYTES
    return (
        not geometry.checked
        or zlib.crc32(ring[start : start + length], newest & layout.SEED_MASK) == meta >> 32
    )


def _make(
    path: Path, geometry: Geometry, mode: int, old_fd: int | None, resume: EpochPosition | None
) -> mmap.mmap | None:
    """Create a ring at the path, or replace the locked old one; returns None if another process was
    faster."""
    unfinished = path.with_name(path.name + layout.UNFINISHED_SUFFIX)
    fd = _open_unfinished(unfinished, mode)
    try:
        # a process that reaps holds the lock for a moment
        if not (try_lock(fd) or lock_within(fd, LOCK_WAIT_S)):
            raise RingBusy(f"{unfinished}: another process is making this ring")
        if not stands_at(fd, unfinished):
            return None
        # Another process has made or replaced the ring between the check and the lock.
        if not _vacant(path, old_fd):
            unfinished.unlink()
            return None
        try:
            if resume is None:
                resume = _first_epoch() if old_fd is None else _inherited_epoch(old_fd)
            ring = _fill(fd, path, geometry, mode, resume)
            if old_fd is not None:
                os.pwrite(
                    old_fd, b"\1", layout.W_MOVED * 8
                )  # damaged or not: its readers must reopen the path
            unfinished.rename(path)
        except OSError:
            unfinished.unlink()
            raise
        return ring
    finally:
        os.close(fd)


def _open_unfinished(path: Path, mode: int) -> int:
    try:
        return open_cleared(path, os.O_RDWR | os.O_CREAT, mode)
    except PermissionError:  # the file belongs to a member of the node's group
        if not discard(path):
            raise
    return open_shared(path, os.O_RDWR | os.O_CREAT, mode)


def _vacant(path: Path, old_fd: int | None) -> bool:
    return not path.exists() if old_fd is None else stands_at(old_fd, path)


def _fill(fd: int, path: Path, geometry: Geometry, mode: int, resume: EpochPosition) -> mmap.mmap:
    os.ftruncate(fd, 0)  # content of a process that was killed here before
    os.posix_fallocate(fd, 0, geometry.file_bytes)  # a full file system is an error now, not a SIGBUS later
    os.fchmod(fd, mode)
    share(fd, path.parent, mode)
    ring = _map(fd, geometry.file_bytes)
    words = memoryview(ring).cast("Q")
    epoch, first = resume
    layout.write_header(words, geometry, nonce=int.from_bytes(os.urandom(8)), epoch=epoch, first=first)
    layout.write_owner(words, Owner.current())
    words.release()
    return ring


def _inherited_epoch(old_fd: int) -> EpochPosition:
    """Epoch and newest sequence of the replaced ring; a new epoch if it is missing or damaged."""
    header = os.pread(old_fd, layout.HEADER_BYTES, 0)
    words = memoryview(header.ljust(layout.HEADER_BYTES, b"\0")).cast("Q")
    with contextlib.suppress(WireError):
        layout.read_header(words, os.fstat(old_fd).st_size, Path())
        if words[layout.W_FIRST] <= words[layout.W_NEWEST] < 1 << 63:
            return words[layout.W_EPOCH], words[layout.W_NEWEST]
    return _first_epoch()


def _first_epoch() -> EpochPosition:
    return int.from_bytes(os.urandom(8)), 0


def mark_moved(fd: int) -> None:
    """Mark the file, so that readers that have mapped it reopen the path."""
    if (
        os.pread(fd, 8, 0) == layout.MAGIC.to_bytes(8, "little")
        and os.fstat(fd).st_size >= layout.HEADER_BYTES
    ):
        os.pwrite(fd, b"\1", layout.W_MOVED * 8)


def unlink_ring(fd: int, path: Path) -> bool:
    """Remove the ring whose lock is held; returns False if another file is at the path."""
    if not stands_at(fd, path):
        return False
    mark_moved(fd)
    try:
        path.unlink()
    except FileNotFoundError:
        return False
    except PermissionError as error:
        raise Denied(f"{path}: no permission") from error
    return True


def map_reading(fd: int, path: Path) -> mmap.mmap:
    """Map a file from outside for reading.

    Raises: WireError when it cannot be a ring.
    """
    file_bytes = os.fstat(fd).st_size
    if file_bytes < layout.HEADER_BYTES or file_bytes % 8 or file_bytes > layout.MAX_RING_BYTES:
        raise WireError(f"{path}: {file_bytes} bytes, expected a ring file")
    try:
        return mmap.mmap(fd, file_bytes, mmap.MAP_SHARED, mmap.PROT_READ)
    except OSError as error:
        raise SwarmError(f"{path}: cannot be mapped: {error.strerror}") from error
