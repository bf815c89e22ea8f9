"""The readers of a ring: a folder beside it with an empty file for each doorbell.

Nothing is mapped or locked: an entry exists or not, whichever process is killed. The folder is
sticky: readers may add entries, and remove only their own. It may exist before the ring:
so a reader waits for a writer.
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
from swarmware.transport.shm.shared_file import discard

MODE: Final = 0o1770
"""Mode of the folder, the only place in shared memory that readers write."""
ENTRIES: Final = 64
"""Maximum doorbells of one user; more are an error, or an attack."""
GRANULE_NS: Final = 20_000_000
"""Two changes within this time may have the same time stamp: twice the longest tick of a kernel."""

ATTEMPTS: Final = 100
"""Maximum attempts: each fails when another process has made or removed the folder meanwhile."""

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
            os.fchmod(self._fd, MODE)  # new: the umask applies to mkdir

    def changed(self) -> bool:
        """Whether the folder must be listed (again), or was removed, which does not change its time."""
        status = os.fstat(self._fd)
        return status.st_mtime_ns != self._seen_ns or status.st_nlink == 0

    @property
    def gone(self) -> bool:
        """Whether the folder was removed from its path."""
        return os.fstat(self._fd).st_nlink == 0

    def names(self, limit: int = ENTRIES) -> tuple[str, ...]:
        """Names of the doorbells; invalid names, and names beyond the limit of a user, are ignored."""
        at_ns = os.fstat(self._fd).st_mtime_ns
        found = []
        of_user: Counter[int] = Counter()
        with os.scandir(self._fd) as entries:
            for entry in entries:
                if NAME.match(entry.name):
                    with contextlib.suppress(FileNotFoundError):
                        status = entry.stat(follow_symlinks=False)
                        if not stat.S_ISREG(status.st_mode):
                            continue  # a member may make anything here
                        of_user[status.st_uid] += 1
                        if of_user[status.st_uid] <= limit:
                            found.append(entry.name)
        self.crowded = of_user[os.geteuid()] > ENTRIES
        # an entry that is added now may get the same time stamp: list the folder again next time
        self._seen_ns = at_ns if utc_ns() - at_ns > GRANULE_NS else -1
        return tuple(found)

    def add(self, name: str) -> bool:
        """Enter a doorbell; False when the folder has been removed meanwhile."""
        try:
            try:
                os.close(os.open(name, _MAKE, 0o600, dir_fd=self._fd))
            except FileExistsError:
                if not stat.S_ISREG(os.stat(name, dir_fd=self._fd, follow_symlinks=False).st_mode):
                    self.remove(name)
                    os.close(os.open(name, _MAKE, 0o600, dir_fd=self._fd))
            os.utime(self._fd)  # also when the entry existed: the writer may have dropped it
        except FileNotFoundError:
            return False
        return True

    def remove(self, name: str) -> None:
        """Remove an entry, or what lies in its place, if this process may."""
        with contextlib.suppress(FileNotFoundError, PermissionError):
            try:
                os.unlink(name, dir_fd=self._fd)
            except IsADirectoryError:
                discard(name, dir_fd=self._fd)

    def close(self) -> None:
        """Close the descriptor of the folder."""
        os.close(self._fd)


def open_readers(path: Path, *, create: bool) -> ReadersFolder | None:
    """The folder at the path, created if it is missing, or None; any other file at the path is replaced.

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
                discard(path)  # a file or a link, which is not expected here
    raise WireError(f"{path}: other processes keep making and removing it")


def _make(path: Path) -> None:
    make_folder(path.parent, path.parent.parent)
    with contextlib.suppress(FileExistsError):
        path.mkdir()
        share_folder(path, path.parent)


def remove_readers(path: Path) -> bool:
    """Removes the folder with its entries; False when a reader was added meanwhile."""
    for entry in list(path.iterdir()):
        discard(entry)
    try:
        path.rmdir()
    except OSError as error:
        if error.errno != errno.ENOTEMPTY:
            raise
        return False
    return True
