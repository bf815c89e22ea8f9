"""Detects how an application ended: an orderly end removes its file, a death does not.

The master moves the files of dead applications aside, which frees the name and keeps the trace.
"""

import os
from pathlib import Path
from typing import Final

from swarmware.errors import WireError
from swarmware.model import paths
from swarmware.model.paths import APPLICATIONS
from swarmware.transport.appfile.entry import FILE_LIMIT, AppEntry, decode
from swarmware.transport.shm.access import node_users
from swarmware.transport.shm.lock import lock_within
from swarmware.transport.shm.shared_file import discard, open_shared

DEAD_SUFFIX: Final = ".dead"
MOMENT_S: Final = 0.02
"""A living application holds its lock permanently, other processes for some ten microseconds."""


def forget(path: Path) -> None:
    """Removes the trace of the application that had this file before.

    Another user's trace stays; `died` distinguishes it by its process.
    """
    discard(path.with_suffix(DEAD_SUFFIX))


def set_aside(path: Path) -> None:
    """Moves the file of a dead application away; the caller has its lock."""
    aside = path.with_suffix(DEAD_SUFFIX)
    try:
        path.replace(aside)
    except IsADirectoryError:
        discard(aside)
        path.replace(aside)


def died(run_dir: Path, entry: AppEntry) -> bool:
    """Whether this application ended without removing its file; call it after the end."""
    return any(
        (found.pid, found.pid_start) == (entry.pid, entry.pid_start)
        for found in _left(run_dir, f"{entry.name}#{entry.instance}")
    )


def last_of(run_dir: Path, name: str) -> AppEntry | None:
    """The first instance of an application that died and has not been replaced yet."""
    return next(iter(_left(run_dir, f"{name}#1")), None)


def _left(run_dir: Path, stem: str) -> list[AppEntry]:
    """Entries whose lock no process holds."""
    found = []
    is_daemon = stem.partition("#")[0] in APPLICATIONS
    for suffix in (".toml", DEAD_SUFFIX):
        path = paths.applications(run_dir) / f"{stem}{suffix}"
        try:
            fd = open_shared(path, limit_bytes=FILE_LIMIT)
        except (OSError, WireError):  # no file with this suffix, or another user's
            continue
        try:
            if is_daemon and os.fstat(fd).st_uid not in node_users(run_dir):
                continue
            # the master may hold it while it moves the file aside
            if lock_within(fd, MOMENT_S):
                found.append(decode(os.pread(fd, FILE_LIMIT, 0), path.name))
        except WireError:
            continue
        finally:
            os.close(fd)
    return found
