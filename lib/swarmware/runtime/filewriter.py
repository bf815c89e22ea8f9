"""Replaces a file atomically: readers see the former or the new content, also after a kill."""

import contextlib
import os
from pathlib import Path
from typing import Final

_FLAGS: Final = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW


def replace_file(path: Path, data: bytes, *, mode: int = 0o640, durable: bool = True) -> None:
    """Write a file under another name, then rename it. `durable`: sync it to the disk before the rename.

    Without that a power failure may leave the file empty.
    Raises: OSError; the former file is then unchanged, and nothing else is left behind.
    """
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        descriptor = os.open(fresh, _FLAGS, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fchmod(descriptor, mode)  # independent of the umask
            if durable:
                os.fsync(descriptor)
        fresh.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            fresh.unlink()  # on a full disk it would occupy the last free space
        raise


def set_aside(path: Path, suffix: str) -> Path:
    """Rename a file that cannot be used, to keep it; returns its name, the old one if that fails."""
    aside = path.with_suffix(suffix)
    try:
        path.rename(aside)
    except OSError:
        return path
    return aside
