"""The doorbell: a named FIFO that wakes one process; and the descriptors by which other processes ring it.

The owner opens it for reading and writing, so it never gets an end of file. Others write one byte without
waiting: EAGAIN means that it is ringing already, ENXIO or EPIPE that it has no owner.
"""

import contextlib
import errno
import fcntl
import os
import re
import select
import stat
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from swarmware.errors import Conflict, Denied
from swarmware.transport.shm.access import make_folder, share
from swarmware.transport.shm.lock import lock_within, stands_at
from swarmware.transport.shm.shared_file import discard, kind_at

NAME = re.compile(r"[A-Za-z0-9_-]{1,47}\Z")
"""Pattern of names, without dot and slash: a name cannot leave the folder."""
FOLDER_WAIT_S = 1.0
"""Maximum wait for the lock of the folder, which is held for some 50 µs while a FIFO is made or removed."""
_PIPE_BYTES = 4096
"""Size of the pipe: one page holds 4096 unread rings, and further ones add no information."""


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Exclude other processes from making or removing a doorbell.

    Without it `reap` could remove a FIFO between its creation and its opening.
    """
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        if not lock_within(fd, FOLDER_WAIT_S):
            raise Conflict(f"{folder}: locked for more than {FOLDER_WAIT_S} s, expected a moment")
        yield
    finally:
        os.close(fd)


def open_sender(path: Path) -> int | None:
    """Descriptor for ringing, or None if the doorbell has no owner.

    Raises: Denied.
    """
    try:
        fd = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError as error:
        # no owner, or something else in its place: neither can be rung
        if error.errno in {errno.ENXIO, errno.ENOENT, errno.ENOTDIR, errno.ELOOP, errno.EISDIR}:
            return None
        if error.errno in {errno.EACCES, errno.EPERM}:
            raise Denied(f"{path}: no permission to ring this doorbell") from error
        raise
    # after the opening: a check before it could be outrun
    if stat.S_ISFIFO(os.fstat(fd).st_mode):
        return fd
    os.close(fd)
    return None


class Doorbell:
    """The doorbell of this process: `fd` for the event loop, `name` for the folders of readers."""

    def __init__(self, folder: Path) -> None:
        make_folder(folder, folder.parent)
        self.folder = folder
        with folder_lock(folder):
            self.name = self._make()
            self.fd, self._capacity_bytes = self._open()

    @property
    def path(self) -> Path:
        """Path of the FIFO."""
        return self.folder / self.name

    @property
    def stands(self) -> bool:
        """Whether the FIFO is at its path, or was closed."""
        return self.fd < 0 or stands_at(self.fd, self.path)

    def _open(self) -> tuple[int, int]:
        fd = os.open(self.path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOFOLLOW)
        try:
            return fd, fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        except OSError:
            return fd, fcntl.fcntl(fd, fcntl.F_GETPIPE_SZ)

    def tend(self) -> Path | None:
        """Make the FIFO again if it was removed or replaced; its path, or None if it stands.

        `fd` is another one then; those who ring the former FIFO notice with their next ring.
        Raises: OSError, Conflict when another process keeps the folder or the path.
        """
        if self.stands:
            return None
        make_folder(self.folder, self.folder.parent)
        with folder_lock(self.folder):
            if not discard(self.path):
                raise Conflict(f"{self.path}: {kind_at(self.path)} of another user; expected our doorbell")
            os.mkfifo(self.path, 0o600)
            share(self.path, self.folder, 0o660)
            former = self.fd
            self.fd, self._capacity_bytes = self._open()
        # after the new one is open: its number must not be given to another file meanwhile
        os.close(former)
        return self.path

    def _make(self) -> str:
        """Create a FIFO with an unused name: the pid and a number."""
        ordinal = 0
        while True:
            name = f"{os.getpid()}-{ordinal}"
            path = self.folder / name
            try:
                os.mkfifo(path, 0o600)
            except FileExistsError:
                owned = open_sender(path)
                if owned is None:  # left by a dead process with the same pid, or no FIFO
                    if discard(path):
                        continue  # else it is another user's: the next name is free
                else:
                    os.close(owned)
                ordinal += 1
                continue
            share(path, self.folder, 0o660)
            return name

    def drain(self) -> bool:
        """Empty the FIFO; read the rings after it, not before. Returns whether it had rung."""
        try:
            return bool(os.read(self.fd, self._capacity_bytes))
        except BlockingIOError:
            return False

    def wait(self, timeout_s: float) -> bool:
        """Block until it rings, and empty it: for programs without an event loop."""
        poll = select.poll()
        poll.register(self.fd, select.POLLIN)
        return bool(poll.poll(timeout_s * 1000)) and self.drain()

    def close(self) -> None:
        """Remove the FIFO; senders notice with their next ring."""
        if self.fd < 0:
            return
        with contextlib.suppress(FileNotFoundError), folder_lock(self.folder):
            if stands_at(self.fd, self.path):
                self.path.unlink()
        os.close(self.fd)
        self.fd = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class DoorbellSenders:
    """Rings the doorbells of other processes, with one descriptor for each doorbell."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._fds: dict[str, int] = {}

    def ring(self, name: str) -> bool:
        """Ring once, without waiting; False when it has no owner, or permission is denied."""
        fd = self._fds.get(name)
        if fd is not None:
            try:
                os.write(fd, b"\1")
            except BlockingIOError:
                return True
            except BrokenPipeError:
                os.close(self._fds.pop(name))
            else:
                return True
        return self._ring_first(name)

    def _ring_first(self, name: str) -> bool:
        try:
            fd = open_sender(self.folder / name)
        except Denied:
            fd = None  # of another user: it must not stop the writer
        if fd is None:
            return False
        try:
            with contextlib.suppress(BlockingIOError):
                os.write(fd, b"\1")
        except BrokenPipeError:
            os.close(fd)
            return False
        self._fds[name] = fd
        return True

    def close(self) -> None:
        """Close all descriptors, which are reopened when needed."""
        while self._fds:
            os.close(self._fds.popitem()[1])
