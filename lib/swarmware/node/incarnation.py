"""One incarnation of a node: its number, and the removal of files of dead processes.

Each process of the node holds a shared lock of one file. The process that gets it exclusively is the first
or the last of the incarnation.
"""

import fcntl
import os
import stat
import time
from pathlib import Path
from typing import Final

from swarmware.errors import Conflict, Denied, WireError
from swarmware.model import paths
from swarmware.model.clock import utc_ns
from swarmware.transport.appfile.table import populated
from swarmware.transport.appfile.trace import DEAD_SUFFIX
from swarmware.transport.shm.access import check_folder, is_guest, make_folder, node_users, share
from swarmware.transport.shm.lock import held_by_other, lock_within, stands_at, try_lock
from swarmware.transport.shm.shared_file import discard, open_cleared, open_shared

LOCK_WAIT_S: Final = 5.0
"""Maximum wait for the lock: the first process of a node holds it for some milliseconds, to sweep."""
LOOK_S: Final = 0.02
"""Pause between two looks for it."""
RESTORED_S: Final = 4.0
"""Maximum wait for the processes of a living node to write its removed file again: they look every second."""

_NUMBER_BYTES: Final = 32
"""Place of the number in the file of the incarnation; the instant of its start follows."""


class NodeIncarnation:
    """The membership of this process in the running node."""

    def __init__(self, run_dir: Path, shm_dir: Path) -> None:
        """Raises: Denied when a folder of the node is another user's, Conflict when its file stays locked."""
        self._run_dir = run_dir
        self._shm_dir = shm_dir
        try:
            run_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
            check_folders(run_dir, shm_dir)
            self._fd, self.guest = self._join()
        except PermissionError as error:
            raise Denied(
                f"{error.filename}: no permission; expected to run as the user of this node, or as a member"
                " of the group that may read this folder"
            ) from error
        self._mode = stat.S_IMODE(run_dir.stat().st_mode)
        self._gid = run_dir.stat().st_gid
        if not self.guest:
            make_folder(shm_dir, run_dir)  # the last process of the former incarnation removes the folder
        self.boot_id = _number(self._fd)
        """Number that increases at each start of the node."""
        self.started_mono_ns = int(os.pread(self._fd, 32, _NUMBER_BYTES) or time.monotonic_ns())
        """Instant of CLOCK_MONOTONIC at which the node started, or the present one if the file is empty."""

    def _join(self) -> tuple[int, bool]:
        """Descriptor of the file with a shared lock, and whether another user runs the node."""
        deadline_s = time.monotonic() + RESTORED_S
        while True:
            fd, writable = _open(self._run_dir)
            try:
                guest = is_guest(self._run_dir)
                is_first = try_lock(fd)
                if is_first and not writable:
                    raise Denied(
                        f"{self._run_dir}: this node does not run; expected its own user to start it"
                    )
                if is_first and not _number(fd) and self._lives() and time.monotonic() < deadline_s:
                    # the file was removed while the node runs: its processes write it again
                    fcntl.flock(fd, fcntl.LOCK_UN)
                    time.sleep(LOOK_S)
                elif stands_at(fd, self._path):
                    if is_first:
                        guest = False
                        self._begin(fd)
                    if not lock_within(fd, LOCK_WAIT_S, shared=True):
                        raise Conflict(
                            f"{self._path}: locked by another process for more than {LOCK_WAIT_S} s"
                        )
                    kept, fd = fd, -1
                    return kept, guest
            finally:
                if fd >= 0:
                    os.close(fd)

    @property
    def _path(self) -> Path:
        return self._run_dir / "boot"

    def _lives(self) -> bool:
        """Whether processes of the node hold files other than the incarnation's."""
        return populated(self._run_dir) or any(map(_is_held, self._shm_dir.glob("*.ring")))

    def _begin(self, fd: int) -> None:
        """Begin a new incarnation: no other process is attached; files of dead processes are removed."""
        # Above the former number, even if the wall clock was set back.
        _write(fd, max(utc_ns(), _number(fd) + 1), time.monotonic_ns())
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
            discard(path)

    def tend(self) -> Path | None:
        """Make the file, and the folders of the node, again if they were removed; its path, or None.

        Raises: OSError, Denied when another user has made one of them.
        """
        if self._fd < 0:
            return None
        if not self.guest and self._run_dir.exists():
            make_folder(self._shm_dir, self._run_dir)
        if stands_at(self._fd, self._path):
            return None
        if self.guest:
            if not self._path.exists():  # the processes of the node's user make it
                return None
        else:
            try:
                self._run_dir.mkdir(mode=0o700, parents=True)
            except FileExistsError:
                check_folder(self._run_dir, frozenset({0, os.geteuid()}))
            else:
                os.chown(self._run_dir, -1, self._gid)
                self._run_dir.chmod(self._mode)
        fd, _ = _open(self._run_dir)
        if not try_lock(fd, shared=True):  # another process begins
            os.close(fd)
            return None
        if not self.guest and not _number(fd):
            _write(fd, self.boot_id, self.started_mono_ns)
        os.close(self._fd)
        self._fd = fd
        return self._path

    def leave(self) -> None:
        """Leave the node; the last process removes the remaining files."""
        if self._fd < 0:
            return
        if not self.guest and try_lock(self._fd) and stands_at(self._fd, self._path):
            from swarmware.transport.shm.reap import remove_all

            self._sweep()
            remove_all(self._shm_dir, self._run_dir)
        os.close(self._fd)
        self._fd = -1


def check_folders(run_dir: Path, shm_dir: Path) -> None:
    """Check that the folders of a node, as far as they exist, are of its user.

    Raises: Denied when one of them is another user's, or no folder.
    """
    if not run_dir.exists():
        users = frozenset({0, os.geteuid()})
        check_folder(shm_dir, users)
        return
    users = node_users(run_dir)
    for path in (
        shm_dir,
        paths.applications(run_dir),
        paths.sockets(run_dir),
        paths.doorbells(run_dir),
    ):
        check_folder(path, users)


def _number(fd: int) -> int:
    """The number in the file, or 0 if it has none."""
    try:
        return int(os.pread(fd, _NUMBER_BYTES, 0) or b"0")
    except ValueError:
        return 0


def _write(fd: int, number: int, started_mono_ns: int) -> None:
    os.ftruncate(fd, 0)
    os.pwrite(fd, b"%-*d%d" % (_NUMBER_BYTES, number, started_mono_ns), 0)


def _is_held(ring: Path) -> bool:
    try:
        fd = open_shared(ring)
    except (OSError, WireError):  # removed meanwhile, or not a ring
        return False
    try:
        return held_by_other(fd)
    finally:
        os.close(fd)


def _open(run_dir: Path) -> tuple[int, bool]:
    """Descriptor of the file that all processes lock, and whether it may be written."""
    path = run_dir / "boot"
    guest = is_guest(run_dir)
    try:
        fd = open_cleared(path, os.O_RDWR | os.O_CREAT)
    except PermissionError:
        try:
            return open_shared(path), False
        except FileNotFoundError:
            raise Denied(f"{run_dir}: this node does not run; expected its own user to start it") from None
    if not guest or os.geteuid() == 0:
        share(fd, run_dir, 0o640)
    return fd, True
