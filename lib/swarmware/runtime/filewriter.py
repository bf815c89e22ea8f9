"""Replaces a file atomically: readers see the former or the new content, also after a kill."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

_FLAGS: Final = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW


@contextlib.contextmanager
def naming(path: Path | str) -> Iterator[None]:
    """Adds the file to errors of the operating system, as a failed write, such as on a full disk, names
    none."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


def replace_file(path: Path, data: bytes, *, mode: int = 0o640, durable: bool = True) -> None:
    """Write a file under another name, then rename it. `durable`: sync it to the disk before the rename.

    Without that a power failure may leave the file empty.
    Raises: OSError; the former file is then unchanged, and nothing else is left behind.
    """
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        descriptor = os.open(fresh, _FLAGS, mode)
        with naming(path), os.fdopen(descriptor, "wb") as file:
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


def write_result(path: Path, data: bytes) -> None:
    """Write a file that an operator named: atomically, but a device or FIFO in place, which stays what it is.

    Raises: OSError with the name of the file.
    """
    if path.exists() and not path.is_file():
        with naming(path), path.open("wb") as file:
            file.write(data)
    else:
        replace_file(path, data)


def set_aside(path: Path, suffix: str) -> Path:
    """Rename a file that cannot be used, to keep it; returns its name, the old one if that fails."""
    aside = path.with_suffix(suffix)
    try:
        path.rename(aside)
    except OSError:
        return path
    return aside
