"""The readers of a ring: a folder beside it with an empty file for each doorbell to be rung.

Nothing is mapped and nothing is locked: an entry is there or not, whoever is killed when. The folder is
sticky: who may read the ring may add an entry, and take away only his own. It may be there before the ring:
so a reader waits for a writer to come.
"""

import contextlib
import errno
import os
import stat
from collections import Counter
from pathlib import Path
from typing import Final

from swarmware.errors import WireError
from swarmware.model.clock import utc_ns
from swarmware.transport.shm.access import make_folder, share_folder
from swarmware.transport.shm.doorbell import NAME
from swarmware.transport.shm.ringfile import file_errors

MODE: Final = 0o1770
"""The one place in shared memory that readers write."""
ENTRIES: Final = 64
"""Doorbells of one user that are rung; more are a mistake, or an attack."""
GRANULE_NS: Final = 20_000_000
"""Two changes of a folder may bear the same time if they are closer: twice the longest tick of a kernel."""

ATTEMPTS: Final = 100
"""Each one is lost to another process that made or removed the folder meanwhile."""

_MAKE: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
_FLAGS: Final = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC | os.O_NOFOLLOW


class ReadersFolder:
    """The open folder of a ring's readers. Raises: OSError."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, _FLAGS)
        self._seen_ns = -1
        self.crowded = False
        """Whether the last listing found more entries of this user than are rung."""
        status = os.fstat(self._fd)
        if status.st_uid == os.geteuid() and stat.S_IMODE(status.st_mode) | stat.S_ISVTX != MODE:
            os.fchmod(self._fd, MODE)  # just made: the umask has its say in mkdir

    def changed(self) -> bool:
        """Whether it has to be listed (again)."""
        return os.fstat(self._fd).st_mtime_ns != self._seen_ns

    @property
    def gone(self) -> bool:
        """Whether it has left its path."""
        return os.fstat(self._fd).st_nlink == 0

    def names(self, limit: int = ENTRIES) -> tuple[str, ...]:
        """The doorbells in it; what cannot be one, or is beyond the limit of one user, is passed over."""
        at_ns = os.fstat(self._fd).st_mtime_ns
        found = []
        of_user: Counter[int] = Counter()
        with os.scandir(self._fd) as entries:
            for entry in entries:
                if NAME.match(entry.name):
                    with contextlib.suppress(FileNotFoundError):
                        user = entry.stat(follow_symlinks=False).st_uid
                        of_user[user] += 1
                        if of_user[user] <= limit:
                            found.append(entry.name)
        self.crowded = of_user[os.geteuid()] > ENTRIES
        # one that is added in this very moment may not change the time: look again next time
        self._seen_ns = at_ns if utc_ns() - at_ns > GRANULE_NS else -1
        return tuple(found)

    def add(self, name: str) -> bool:
        """Enter a doorbell; False when the folder has been removed meanwhile."""
        try:
            with contextlib.suppress(FileExistsError):
                os.close(os.open(name, _MAKE, 0o600, dir_fd=self._fd))
            os.utime(self._fd)  # also when the entry was there: the writer may have dropped it
        except FileNotFoundError:
            return False
        return True

    def remove(self, name: str) -> None:
        """Take an entry away, if it is ours to take."""
        with contextlib.suppress(FileNotFoundError, PermissionError):
            os.unlink(name, dir_fd=self._fd)

    def close(self) -> None:
        """Let go of the folder."""
        os.close(self._fd)


def open_readers(path: Path, *, create: bool) -> ReadersFolder | None:
    """The folder at the path, made if it is missing, or None; what else stands there gives way to it.

    Raises: Denied, WireError, RingFull.
    """
    with file_errors(path):
        for _ in range(ATTEMPTS):
            try:
                return ReadersFolder(path)
            except FileNotFoundError:
                if not create:
                    return None
                _make(path)
            except OSError as error:
                if error.errno not in {errno.ENOTDIR, errno.ELOOP} or not path.parent.is_dir():
                    raise
                with contextlib.suppress(FileNotFoundError):
                    path.unlink()  # a file or a link: nothing of ours
    raise WireError(f"{path}: other processes keep making and removing it")


def _make(path: Path) -> None:
    make_folder(path.parent, path.parent.parent)
    with contextlib.suppress(FileExistsError):
        path.mkdir()
        share_folder(path, path.parent)


def remove_readers(path: Path) -> bool:
    """Removes the folder with what is in it; False when a reader has come meanwhile."""
    for entry in list(path.iterdir()):
        entry.unlink(missing_ok=True)
    try:
        path.rmdir()
    except OSError as error:
        if error.errno != errno.ENOTEMPTY:
            raise
        return False
    return True
