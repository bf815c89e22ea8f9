"""What the file of an application says after its end: one that left took it away, one that died could not.

The master sets the files of the dead aside, so that the name is free and the trace stays.
"""

import contextlib
import os
from pathlib import Path
from typing import Final

from swarmware.errors import WireError
from swarmware.model import paths
from swarmware.transport.appfile.entry import AppEntry, decode
from swarmware.transport.shm.lock import lock_within

DEAD_SUFFIX: Final = ".dead"
MOMENT_S: Final = 0.02
"""A living application holds its file for good, everybody else for some ten microseconds."""


def forget(path: Path) -> None:
    """Removes the trace of the application that had this file before."""
    with contextlib.suppress(PermissionError):  # of another user; told apart by its process
        path.with_suffix(DEAD_SUFFIX).unlink(missing_ok=True)


def set_aside(path: Path) -> None:
    """Moves the file of a dead application away; the caller has its lock."""
    path.replace(path.with_suffix(DEAD_SUFFIX))


def died(run_dir: Path, entry: AppEntry) -> bool:
    """Whether this very application ended without taking its file away; to be asked when it is gone."""
    return any(
        (found.pid, found.pid_start) == (entry.pid, entry.pid_start)
        for found in _left(run_dir, f"{entry.name}#{entry.instance}")
    )


def last_of(run_dir: Path, name: str) -> AppEntry | None:
    """The first instance of an application that died and has not been followed by another yet."""
    return next(iter(_left(run_dir, f"{name}#1")), None)


def _left(run_dir: Path, stem: str) -> list[AppEntry]:
    """Entries that nobody holds."""
    found = []
    for suffix in (".toml", DEAD_SUFFIX):
        path = paths.applications(run_dir) / f"{stem}{suffix}"
        try:
            fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
        except OSError:
            continue
        try:
            # the master may hold it for the moment in which it sets the file aside
            if lock_within(fd, MOMENT_S):
                found.append(decode(os.pread(fd, os.fstat(fd).st_size, 0), path.name))
        except WireError:
            continue
        finally:
            os.close(fd)
    return found
