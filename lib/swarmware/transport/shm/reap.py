"""Reaping: removes files of dead processes from a node's folders, never a living process's.

The lock decides, not the pid: the kernel releases it with its holder, in any PID namespace. Rings
of dead writers are removed, too, so reap when a node starts or ends, not while a service restarts.
"""

import contextlib
import os
from pathlib import Path

import msgspec

from swarmware.errors import Conflict, Denied, NotFound, WireError
from swarmware.model import paths
from swarmware.transport.shm import layout
from swarmware.transport.shm.doorbell import folder_lock, open_sender
from swarmware.transport.shm.lock import try_lock
from swarmware.transport.shm.readers import remove_readers
from swarmware.transport.shm.ringfile import unlink_ring
from swarmware.transport.shm.shared_file import discard, open_shared

_UNFINISHED = layout.RING_SUFFIX + layout.UNFINISHED_SUFFIX
_MARK = layout.MAGIC.to_bytes(8, "little")


class Reaped(msgspec.Struct, frozen=True):
    """Removed files, and files that could not be removed."""

    removed: tuple[Path, ...]
    denied: tuple[Path, ...]
    """Files of dead processes that belong to another user."""


def reap(shm_dir: Path, run_dir: Path) -> Reaped:
    """Remove rings, tables and doorbells that no living process uses; missing folders count as empty."""
    return _sweep(shm_dir, paths.doorbells(run_dir), even_used=False)


def remove_all(shm_dir: Path, run_dir: Path) -> Reaped:
    """Remove all rings, tables of readers and doorbells, used or not, and the folders left empty."""
    bells_dir = paths.doorbells(run_dir)
    reaped = _sweep(shm_dir, bells_dir, even_used=True)
    for folder in (*_folders(shm_dir)[1:], shm_dir, bells_dir):
        with contextlib.suppress(OSError):  # it has other files, or was removed
            folder.rmdir()
    return reaped


def _sweep(shm_dir: Path, bells_dir: Path, *, even_used: bool) -> Reaped:
    found = [path for folder in _folders(shm_dir) for path in _entries(folder)]
    rings = [
        path for path in found if path.name.endswith((layout.RING_SUFFIX, _UNFINISHED)) and _is_file(path)
    ]
    tables = [path for path in found if _is_table(path)]
    removed: list[Path] = []
    denied: list[Path] = []
    # tables after rings: a ring that remains has a living writer, which needs its table
    for path in (*rings, *tables, *_fifos(bells_dir)):
        try:
            if path in rings:
                gone = _remove_ring(path, even_used=even_used)
            elif path in tables:
                gone = _remove_table(path, bells_dir, even_used=even_used)
            else:
                gone = _remove_bell(path, even_used=even_used)
        except (PermissionError, Denied):
            # the node ends and the folder is ours: files of members of its group are removed, too
            (removed if even_used and _unlinked(path) else denied).append(path)
        except (FileNotFoundError, NotFound, Conflict, WireError):
            continue  # another process has removed it or uses it now, or it is not one of our files
        else:
            if gone:
                removed.append(path)
    return Reaped(tuple(removed), tuple(denied))


def _unlinked(path: Path) -> bool:
    try:
        path.unlink(missing_ok=True)
    except PermissionError:
        return False
    return True


def _folders(shm_dir: Path) -> tuple[Path, ...]:
    """The folder of the node's own rings, then the folders of its mirrors."""
    return (shm_dir, *mirror_folders(shm_dir))


def mirror_folders(shm_dir: Path) -> list[Path]:
    """The folders of a node's mirrors, one per platform and of its name."""
    inner = (path for path in _entries(shm_dir) if path.is_dir() and not path.is_symlink())
    return [path for path in inner if not _is_table(path)]


def _is_table(path: Path) -> bool:
    return path.name.endswith(layout.READERS_SUFFIX) and path.is_dir() and not path.is_symlink()


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except (FileNotFoundError, NotADirectoryError):
        return []


def _is_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _fifos(bells_dir: Path) -> list[Path]:
    return [path for path in _entries(bells_dir) if path.is_fifo()]


def reap_ring(path: Path) -> bool:
    """Remove one ring without a living writer; returns whether it was removed."""
    try:
        return _remove_ring(path, even_used=False)
    except (FileNotFoundError, PermissionError, Denied, WireError):
        return not path.exists()


def _remove_ring(path: Path, *, even_used: bool) -> bool:
    fd = open_shared(path, os.O_RDWR)
    try:
        start = os.pread(fd, len(_MARK), 0)
        ours = start == _MARK or (path.name.endswith(_UNFINISHED) and not any(start))
        return ours and (try_lock(fd) or even_used) and unlink_ring(fd, path)
    finally:
        os.close(fd)


def _remove_table(path: Path, bells_dir: Path, *, even_used: bool) -> bool:
    if even_used:
        return remove_readers(path)
    alive = False
    for entry in _entries(path):
        fd = open_sender(bells_dir / entry.name)
        if fd is None:
            discard(entry)
        else:
            os.close(fd)
            alive = True
    if alive or path.with_suffix(layout.RING_SUFFIX).exists():
        return False
    with contextlib.suppress(OSError):  # a reader was added meanwhile
        path.rmdir()
        return True
    return False


def _remove_bell(path: Path, *, even_used: bool) -> bool:
    with folder_lock(path.parent):
        if not even_used:
            fd = open_sender(path)
            if fd is not None:
                os.close(fd)
                return False
        path.unlink()
        return True
