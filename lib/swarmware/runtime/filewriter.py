"""Replaces a file as a whole: readers see the former content or the new, also after a kill."""

import contextlib
import os
from pathlib import Path
from typing import Final

_FLAGS: Final = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW


def replace_file(path: Path, data: bytes, *, mode: int = 0o640, durable: bool = True) -> None:
    """Write a file under another name, then rename it. `durable`: it is on the disk before the rename.

    Without that a power cut may leave the new name without its bytes.
    Raises: OSError; the former file is then unchanged, and nothing else is left behind.
    """
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        descriptor = os.open(
            fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW, mode
        )
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fchmod(descriptor, mode)  # whatever the umask is
            if durable:
                os.fsync(descriptor)
        fresh.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            fresh.unlink()  # on a full disk it would take the last room
        raise
