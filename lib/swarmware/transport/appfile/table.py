"""The living applications of this node, read from their files."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from swarmware.errors import WireError
from swarmware.model import paths
from swarmware.model.names import natural
from swarmware.transport.appfile.entry import AppEntry, Served, decode
from swarmware.transport.shm.lock import held_by_other

_Stamp = tuple[int, int, int]
_FLAGS: Final = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW


class AppTable:
    """Table of the application files, which reads only changed ones.

    Not `whole`: its entries have what messages need, and neither `provides` nor `config`, until `complete`.
    """

    def __init__(self, run_dir: Path, *, whole: bool = True) -> None:
        self._whole = whole
        self._folder_name = str(paths.applications(run_dir))
        self._folder_ns = 0
        self._files: dict[str, tuple[_Stamp, AppEntry]] = {}
        self._names: list[str] = []
        """Names of the files, in their order."""
        self._served: dict[int, tuple[AppEntry, Served]] = {}
        self._by_id: dict[int, AppEntry] = {}
        self.version = 0
        """Number of changes so far."""
        self.on_change: Callable[[], None] | None = None
        """Called after every change that any refresh found."""

    def __iter__(self) -> Iterator[AppEntry]:
        return iter(self._by_id.values())

    def __len__(self) -> int:
        return len(self._by_id)

    def complete(self) -> None:
        """Read the whole files from now on."""
        if not self._whole:
            self._whole = True
            self._files.clear()
            self._folder_ns = 0

    def refresh(self, *, probe: bool = False) -> None:
        """Check for changes; with `probe` also for applications that died."""
        try:
            folder_ns = os.stat(self._folder_name).st_mtime_ns  # noqa: PTH116  # at every bell: no Path object
        except FileNotFoundError:
            folder_ns = 0
        if folder_ns == self._folder_ns and not probe:
            return
        before = list(self._files.values())
        self._folder_ns = folder_ns
        self._files = dict(self._read())
        self._by_id = {entry.app_id: entry for _, entry in self._files.values()}
        self._served = {item.data_id: (entry, item) for entry in self for item in entry.serves}
        if before != list(self._files.values()):
            self.version += 1
            if self.on_change is not None:
                self.on_change()

    def _read(self) -> Iterator[tuple[str, tuple[_Stamp, AppEntry]]]:
        try:
            listed = os.listdir(self._folder_name)  # noqa: PTH208  # every second: no Path objects
        except FileNotFoundError:
            return
        found = {name for name in listed if name.endswith(".toml")}
        if found != set(self._names):
            self._names = sorted(found, key=natural)
        folder = self._folder_name
        for name in self._names:
            known = self._files.get(name)
            try:
                fd = os.open(f"{folder}/{name}", _FLAGS)  # every second: no Path objects
            except FileNotFoundError:
                continue  # it has just left
            except OSError:
                # no free descriptor, or not a file: a known application is not removed for that
                self._folder_ns = 0
                if known is not None:
                    yield name, known
                continue
            try:
                if not held_by_other(fd):
                    continue
                status = os.fstat(fd)
                stamp = (status.st_ino, status.st_mtime_ns, status.st_size)
                if known is not None and known[0] == stamp:
                    yield name, known
                    continue
                yield name, (stamp, decode(os.pread(fd, status.st_size, 0), name, whole=self._whole))
            except WireError:
                # it is being written: its writer announces when it is complete
                self._folder_ns = 0
                if known is not None:
                    yield name, known
            finally:
                os.close(fd)

    def serving(self, data_id: int) -> AppEntry | None:
        """The application that serves messages or requests of this data id."""
        found = self._served.get(data_id)
        return None if found is None else found[0]

    def path_of(self, data_id: int) -> str | None:
        """The local path of an address with this data id."""
        found = self._served.get(data_id)
        return None if found is None else found[1].path

    def serving_path(self, path: str) -> tuple[AppEntry, Served] | None:
        """The application that serves messages or requests of any type at this local path."""
        for entry in self:
            for item in entry.serves:
                if item.path == path:
                    return entry, item
        return None

    def application(self, app_id: int) -> AppEntry | None:
        """The application of this id."""
        return self._by_id.get(app_id)

    def named(self, name: str) -> AppEntry | None:
        """The first instance of the application of this name."""
        return next((entry for entry in self if entry.name == name), None)


def populated(run_dir: Path) -> bool:
    """Whether an application runs on the node of this run directory; it reads only locks, no content."""
    for path in paths.applications(run_dir).glob(paths.APPLICATION_PATTERN):
        try:
            fd = os.open(path, _FLAGS)
        except OSError:
            continue  # it has just left, or is not a file
        try:
            if held_by_other(fd):
                return True
        finally:
            os.close(fd)
    return False


def scan(run_dir: Path) -> list[AppEntry]:
    """The applications that run on the node of this run directory."""
    table = AppTable(run_dir)
    table.refresh(probe=True)
    return list(table)
