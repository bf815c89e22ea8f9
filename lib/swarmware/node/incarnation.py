"""One incarnation of a node: its number, and the removal of files of dead processes.

Each process of the node holds a shared lock of one file. The process that gets it exclusively is the first
or the last of the incarnation.
"""

import fcntl
import os
import time
from pathlib import Path
from typing import Final

from swarmware.errors import Denied
from swarmware.model import paths
from swarmware.model.clock import utc_ns
from swarmware.transport.appfile.trace import DEAD_SUFFIX
from swarmware.transport.shm.access import is_guest, make_folder, share
from swarmware.transport.shm.lock import try_lock

_NUMBER_BYTES: Final = 32
"""Place of the number in the file of the incarnation; the instant of its start follows."""


class NodeIncarnation:
    """The membership of this process in the running node."""

    def __init__(self, run_dir: Path, shm_dir: Path) -> None:
        self._run_dir = run_dir
        self._shm_dir = shm_dir
        try:
            run_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._fd, writable = _open(run_dir)
        except PermissionError as error:
            raise Denied(
                f"{error.filename}: no permission; expected to run as the user of this node, or as a member"
                " of the group that may read this folder"
            ) from error
        self.guest = is_guest(run_dir)
        """Whether another user runs the node, and lets this process join."""
        if try_lock(self._fd):
            if not writable:
                os.close(self._fd)
                raise Denied(f"{run_dir}: this node does not run; expected its own user to start it")
            self.guest = False
            self._begin()
        fcntl.flock(self._fd, fcntl.LOCK_SH)  # an exclusive lock is held for some milliseconds only
        if not self.guest:
            make_folder(shm_dir, run_dir)  # the last process of the former incarnation removes the folder
        self.boot_id = int(os.pread(self._fd, _NUMBER_BYTES, 0) or b"0")
        """Number that increases at each start of the node."""
        self.started_mono_ns = int(os.pread(self._fd, 32, _NUMBER_BYTES) or time.monotonic_ns())
        """Instant of CLOCK_MONOTONIC at which the node started; the present one after an older version."""

    def _begin(self) -> None:
        """Begin a new incarnation: no other process is attached; files of dead processes are removed."""
        boot_id = max(utc_ns(), int(os.pread(self._fd, _NUMBER_BYTES, 0) or b"0") + 1)
        os.ftruncate(self._fd, 0)
        os.pwrite(self._fd, b"%-*d%d" % (_NUMBER_BYTES, boot_id, time.monotonic_ns()), 0)
        self._sweep()

    def _sweep(self) -> None:
        from swarmware.transport.shm.reap import reap  # in the first and last process of a node only

        reap(self._shm_dir, self._run_dir)
        applications, sockets = paths.applications(self._run_dir), paths.sockets(self._run_dir)
        for path in (
            *applications.glob(paths.APPLICATION_PATTERN),
            *applications.glob(f"*{DEAD_SUFFIX}"),
            *sockets.glob(paths.SOCKET_PATTERN),
        ):
            path.unlink(missing_ok=True)

    def leave(self) -> None:
        """Leave the node; the last process removes the remaining files."""
        if self._fd < 0:
            return
        if not self.guest and try_lock(self._fd):
            from swarmware.transport.shm.reap import remove_all

            self._sweep()
            remove_all(self._shm_dir, self._run_dir)
        os.close(self._fd)
        self._fd = -1


def _open(run_dir: Path) -> tuple[int, bool]:
    """Descriptor of the file that all processes lock, and whether it may be written."""
    path = run_dir / "boot"
    flags = os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        fd = os.open(path, os.O_RDWR | os.O_CREAT | flags, 0o600)
    except PermissionError:
        return os.open(path, os.O_RDONLY | flags), False
    if not is_guest(run_dir):
        share(fd, run_dir, 0o640)
    return fd, True
