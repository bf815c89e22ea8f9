"""The file of this application: locked while it runs, rewritten in place, removed at its end."""

import contextlib
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from swarmware.errors import Conflict, Denied, OutOfRange, WireError
from swarmware.model import paths
from swarmware.model.clock import utc_ns
from swarmware.model.names import check_application
from swarmware.model.paths import APPLICATIONS
from swarmware.runtime.pidfd import start_ticks
from swarmware.transport.appfile import trace
from swarmware.transport.appfile.entry import FILE_LIMIT, AppEntry, decode, encode
from swarmware.transport.shm.access import make_folder, node_users, share, user_name
from swarmware.transport.shm.lock import RETRY_S, lock_within, stands_at, try_lock
from swarmware.transport.shm.shared_file import discard, open_shared

LOCK_WAIT_S = 0.1
"""Wait for the lock of a free file, which others hold for some 10 µs to probe it."""
INSTANCES = 64
"""Maximum number of instances of one application."""


class AppFile:
    """The locked file of one application.

    `announce` is called after each change. `config` and `live` are in the file from the beginning: a process
    that finds the file of a guard decides by it which process starts the next one.
    Raises: Conflict when the instance, or every instance, is taken; Denied when a daemon has the name,
    and this process runs as another user than the node.
    """

    def __init__(
        self,
        run_dir: Path,
        name: str,
        *,
        endpoint: str,
        started_ns: int,
        instance: int | None = None,
        config: dict[str, Any] | None = None,
        live: Mapping[str, str] | None = None,
        announce: Callable[[], None] = lambda: None,
    ) -> None:
        check_application(name)
        self._run_dir = run_dir
        self._folder = paths.applications(run_dir)
        make_folder(self._folder, run_dir)
        self._users = node_users(run_dir)
        if name in APPLICATIONS and os.geteuid() not in self._users:
            user = user_name(max(self._users))
            raise Denied(f"application {name!r}: a daemon of {user}; expected another name")
        self._announce = announce
        self._fd, self.path, number = self._claim(name, instance)
        pid = os.getpid()
        self.entry = AppEntry(
            name=name,
            instance=number,
            pid=pid,
            pid_start=start_ticks(pid),
            endpoint=endpoint,
            started_ns=started_ns,
            config=config or {},
            live=dict(live or {}),
        )
        self.write(self.entry)

    def _claim(self, name: str, instance: int | None) -> tuple[int, Path, int]:
        for number in (instance,) if instance is not None else range(1, INSTANCES + 1):
            path = self._folder / paths.application_file(name, number)
            fd = _lock(path, self._users)
            if fd is not None:
                # The name is replaced: `last_of` must not report the former process any more.
                trace.forget(path)
                return fd, path, number
        which = f"{name}#{instance}" if instance is not None else f"every instance of {name}"
        raise Conflict(f"{self._folder}: {which} runs already; expected a free instance number")

    def write(self, entry: AppEntry) -> None:
        """Replace the content and notify the readers."""
        data = encode(entry)
        if len(data) > FILE_LIMIT:
            raise OutOfRange(
                f"{self.path}: {len(data)} bytes; expected at most {FILE_LIMIT}: fewer resources and types"
            )
        os.pwrite(self._fd, data, 0)
        os.ftruncate(self._fd, len(data))
        self.entry = entry
        self._touch()
        self._announce()

    @property
    def closed(self) -> bool:
        """Whether the application has left."""
        return self._fd < 0

    def _touch(self) -> None:
        # a file rewritten in place does not change its folder: `AppTable.refresh` checks this time
        now_ns = utc_ns()
        with contextlib.suppress(FileNotFoundError):
            try:
                os.utime(self._folder, ns=(now_ns, now_ns))
            except PermissionError:
                _touch_anothers(self._folder)

    @property
    def is_foreign(self) -> bool:
        """Whether the application belongs to a user other than the node's or root."""
        return os.fstat(self._fd).st_uid not in self._users

    def tend(self) -> Path | None:
        """Write the file again if it was removed or replaced; its path, or None if it stands.

        Raises: Conflict when another process has taken the name meanwhile, OSError.
        """
        if self._fd < 0 or stands_at(self._fd, self.path):
            return None
        make_folder(self._folder, self._run_dir)
        fd = _lock(self.path, self._users)
        if fd is None:
            raise Conflict(f"{self.path}: removed, and taken by another process; expected {self.entry.id}")
        os.close(self._fd)
        self._fd = fd
        self.write(self.entry)
        return self.path

    def close(self) -> None:
        """Leave the node: remove the file, then release its lock."""
        if self._fd < 0:
            return
        with contextlib.suppress(FileNotFoundError):
            if stands_at(self._fd, self.path):
                self.path.unlink()
        os.close(self._fd)
        self._fd = -1
        self._announce()


def _touch_anothers(folder: Path) -> None:
    """Touches a folder of another user, with the kernel's time, whose resolution is some 4 ms."""
    before_ns = folder.stat().st_mtime_ns
    while folder.stat().st_mtime_ns == before_ns:
        time.sleep(RETRY_S)
        os.utime(folder)


def _open(path: Path) -> int | None:
    """Descriptor of the file, which is created if it is missing, or None if something else keeps the path.

    Not in one call: Linux refuses O_CREAT on the file of another user in a sticky folder.
    """
    while True:
        with contextlib.suppress(FileNotFoundError):
            try:
                return open_shared(path, os.O_RDWR)
            except WireError:  # no regular file
                if not discard(path):
                    return None
        with contextlib.suppress(FileExistsError):
            fd = open_shared(path, os.O_RDWR | os.O_CREAT | os.O_EXCL)
            share(fd, path.parent, 0o640)
            return fd


def _remove_imposter(path: Path, users: frozenset[int]) -> None:
    """Remove a file with the name of a daemon that another user has made."""
    if path.name.partition("#")[0] in APPLICATIONS:
        with contextlib.suppress(FileNotFoundError):
            if path.lstat().st_uid not in users:
                discard(path)


def _lock(path: Path, users: frozenset[int]) -> int | None:
    """Descriptor of the locked file, or None if a living application, or another user, holds it."""
    while True:
        _remove_imposter(path, users)
        try:
            fd = _open(path)
        except PermissionError as error:
            if path.exists():
                return None
            raise Denied(f"{path}: no permission; expected to run as the user of this node") from error
        if fd is None:
            return None
        if not try_lock(fd) and (_holder_lives(fd) or not lock_within(fd, LOCK_WAIT_S)):
            os.close(fd)
            return None
        if stands_at(fd, path):
            return fd
        os.close(fd)  # its last holder removed it between our open and our lock


def _holder_lives(fd: int) -> bool:
    try:
        entry = decode(os.pread(fd, FILE_LIMIT, 0), "")
    except WireError:
        return False
    return entry.lives
