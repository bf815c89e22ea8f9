"""Files in folders that several users of this computer write: opened without waiting, checked, removed.

Anything may lie at a path of such a folder: a FIFO, whose opening waits, a folder, a link, a file of many
gigabytes. `open_shared` returns regular files of the expected size only.
"""

from __future__ import annotations

import errno
import os
import stat

from swarmware.errors import WireError
from swarmware.footprint.annotations import Path

_ALWAYS = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
_REFUSED = ".refused"
"""Suffix of the name under which a folder with content stays: no program looks for it."""
_NO_FILE = frozenset({errno.ELOOP, errno.EISDIR, errno.ENXIO, errno.ENODEV})
"""Errors of `open` at a link, a folder, a socket, a FIFO without a reader, a device without a driver."""
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFSOCK: "a socket",
    stat.S_IFREG: "a regular file",
}


def open_shared(
    path: Path | str, flags: int = os.O_RDONLY, mode: int = 0o600, *, limit_bytes: int | None = None
) -> int:
    """Open the regular file at the path, without waiting and without following a link.

    `limit_bytes`: maximum size, or None for a file of which the caller reads only a part of fixed size.
    Raises: OSError; WireError when it is not a regular file, or is larger.
    """
    try:
        fd = os.open(path, flags | _ALWAYS, mode)
    except OSError as error:
        if error.errno in _NO_FILE:
            raise WireError(f"{path}: {kind_at(path)}; expected a regular file") from error
        raise
    status = os.fstat(fd)
    if stat.S_ISREG(status.st_mode) and (limit_bytes is None or status.st_size <= limit_bytes):
        return fd
    os.close(fd)
    if not stat.S_ISREG(status.st_mode):
        raise WireError(f"{path}: {_kind(status.st_mode)}; expected a regular file")
    raise WireError(f"{path}: {status.st_size} bytes; expected at most {limit_bytes}")


def open_cleared(path: Path | str, flags: int, mode: int = 0o600) -> int:
    """Open the regular file at the path as `open_shared`; anything else there is removed before.

    Raises: OSError; WireError when it cannot be removed.
    """
    try:
        return open_shared(path, flags, mode)
    except WireError:
        if not discard(path):
            raise
    return open_shared(path, flags, mode)


def kind_at(path: Path | str) -> str:
    """Kind of the file at the path, in words: `a FIFO`."""
    try:
        return _kind(os.lstat(path).st_mode)
    except OSError:  # removed meanwhile, or in a folder without permission
        return "no file"


def _kind(mode: int) -> str:
    return _KINDS.get(stat.S_IFMT(mode), "a device")


def discard(path: Path | str, dir_fd: int | None = None) -> bool:
    """Clear the path, whatever lies there; returns whether nothing lies there now.

    Nothing below a folder is removed: a folder with content gets another name.
    `dir_fd`: the open folder to which the path is relative, or None.
    """
    try:
        status = os.stat(path, dir_fd=dir_fd, follow_symlinks=False)
        if not stat.S_ISDIR(status.st_mode):
            os.unlink(path, dir_fd=dir_fd)
            return True
        try:
            os.rmdir(path, dir_fd=dir_fd)
        except OSError:  # it has content, or this process may only rename it
            if os.fspath(path).endswith(_REFUSED):
                return False
            aside = f"{os.fspath(path)}.{status.st_ino}{_REFUSED}"
            os.rename(path, aside, src_dir_fd=dir_fd, dst_dir_fd=dir_fd)
    except FileNotFoundError:
        return True
    except OSError:  # of another user in a sticky folder: the caller says what is in its way
        return False
    return True
