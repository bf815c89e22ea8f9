"""The living applications of this node, read from their files."""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmware.errors import Conflict, WireError
from swarmware.model import paths
from swarmware.model.names import natural
from swarmware.transport.appfile.claims import AddressClaims, LivingApplication
from swarmware.transport.appfile.entry import FILE_LIMIT, AppEntry, Served, decode
from swarmware.transport.shm.access import node_users
from swarmware.transport.shm.lock import held_by_other
from swarmware.transport.shm.shared_file import open_shared


class _Stamp(NamedTuple):
    """State of a file: while it is the same, its content is."""

    inode: int
    modified_ns: int
    size_bytes: int
    uid: int


WRITING_TIME_NS = 2_000_000_000
"""Maximum time between the first and last byte of a file: its writer may lose the processor in between."""


class _LeftOut(NamedTuple):
    """A file that is left out until it changes."""

    stamp: _Stamp | None
    reason: str
    certain_ns: int
    """Instant from which the file counts as damaged; before, its writer may not have ended it."""


class AppTable:
    """Table of the application files, which reads only changed ones.

    Not `whole`: its entries have what messages need, and neither `provides` nor `config`, until `complete`.
    Files of another format, such as a FIFO, are left out and named in `rejections`, and so are files with the
    name of a daemon that belong to a user other than the node's or root.
    """

    def __init__(
        self, run_dir: Path, *, whole: bool = True, now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._whole = whole
        self._now_ns = now_ns
        self._run_dir = run_dir
        self._folder_name = str(paths.applications(run_dir))
        self._folder_ns = 0
        self._owners: frozenset[int] | None = None
        """Users whose applications belong to the node: the owner of its run directory, and root."""
        self._files: dict[str, tuple[_Stamp, LivingApplication]] = {}
        self._names: list[str] = []
        """File names in natural order, so that `a#10` comes after `a#2`."""
        self._refused: dict[str, _LeftOut] = {}
        """Files that were left out, by their names."""
        self._claims = AddressClaims()
        self.version = 0
        """Number of changes so far."""
        self.on_change: Callable[[], None] | None = None
        """Called after every change that any refresh found."""

    def __iter__(self) -> Iterator[AppEntry]:
        return iter(self._claims.entries)

    def __len__(self) -> int:
        return len(self._claims.entries)

    @property
    def of_node(self) -> Sequence[AppEntry]:
        """The applications of the node's own user, and of root."""
        return self._claims.of_node

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
        # The time of the folder also changes when no application has.
        if before != list(self._files.values()):
            self._claims = AddressClaims([found for _, found in self._files.values()], self._claims)
            self.version += 1
            if self.on_change is not None:
                self.on_change()

    def _read(self) -> Iterator[tuple[str, tuple[_Stamp, LivingApplication]]]:
        before, self._refused = self._refused, {}
        now_ns = self._now_ns()
        try:
            listed = os.listdir(self._folder_name)  # noqa: PTH208  # every second: no Path objects
        except FileNotFoundError:
            return
        found = {name for name in listed if name.endswith(".toml")}
        if found != set(self._names):
            self._names = sorted(found, key=natural)
        for name in self._names:
            known = self._files.get(name)
            try:
                fd = open_shared(f"{self._folder_name}/{name}", limit_bytes=FILE_LIMIT)
            except FileNotFoundError:
                continue  # the application left after the listing
            except WireError as error:
                self._refused[name] = _LeftOut(None, str(error), certain_ns=0)
                continue
            except OSError:
                # no free descriptor, or no permission yet: a known application is not removed for that
                self._folder_ns = 0
                if known is not None:
                    yield name, known
                continue
            try:
                if not held_by_other(fd):
                    continue
                status = os.fstat(fd)
                stamp = _Stamp(status.st_ino, status.st_mtime_ns, status.st_size, status.st_uid)
                refused = before.get(name)
                if refused is not None and refused.stamp != stamp:
                    refused = None
                if refused is not None and now_ns >= refused.certain_ns:
                    self._refused[name] = refused
                elif known is None or known[0] != stamp:
                    known = (stamp, self._decoded(fd, name, status.st_uid))
            except Conflict as error:
                self._refused[name] = _LeftOut(stamp, str(error), certain_ns=0)
                known = None
            except WireError as error:
                # it is being written: its writer announces when it is complete
                self._folder_ns = 0
                self._refused[name] = refused or _LeftOut(stamp, str(error), now_ns + WRITING_TIME_NS)
                if known is not None and (known[0].inode, known[0].uid) != (stamp.inode, stamp.uid):
                    known = None  # another file took its place
            finally:
                os.close(fd)
            if known is not None:
                yield name, known

    def _decoded(self, fd: int, name: str, uid: int) -> LivingApplication:
        """The application of this file. Raises: WireError; Conflict when the file does not count."""
        path = f"{self._folder_name}/{name}"
        # the size was checked when the file was opened, and may have grown since
        entry = decode(os.pread(fd, FILE_LIMIT, 0), path, whole=self._whole)
        found = LivingApplication(entry, uid, is_own=uid in self._node_users())
        if name != paths.application_file(entry.name, entry.instance):
            raise Conflict(f"{path}: states application {entry.id}; expected the one of the file's name")
        if entry.name in paths.APPLICATIONS and not found.is_own:
            raise Conflict(f"{path}: of {found.user}; {entry.name} is a daemon of the node's user")
        return found

    def _node_users(self) -> frozenset[int]:
        # once: the user of a node never changes, and its folder may be removed and made again by another one
        if self._owners is None:
            self._owners = node_users(self._run_dir)
        return self._owners

    @property
    def rejections(self) -> tuple[str, ...]:
        """Errors in the folder, a line each: files that are not application files, and refused claims."""
        now_ns = self._now_ns()
        files = (refusal.reason for refusal in self._refused.values() if now_ns >= refusal.certain_ns)
        return (*files, *self._claims.refused)

    @property
    def endpoints(self) -> Mapping[int, str]:
        """Sockets of the processes, by the ids of their applications."""
        return self._claims.endpoints

    @property
    def serving_endpoints(self) -> Mapping[int, str]:
        """Sockets of the processes that serve messages or requests, by data id."""
        return self._claims.serving_endpoints

    def serving(self, data_id: int) -> AppEntry | None:
        """The application that serves messages or requests of this data id."""
        found = self._claims.of_data_id(data_id)
        return None if found is None else found[0]

    def path_of(self, data_id: int) -> str | None:
        """The local path of an address with this data id."""
        found = self._claims.of_data_id(data_id)
        return None if found is None else found[1].path

    def serving_path(self, path: str) -> tuple[AppEntry, Served] | None:
        """The application that serves messages or requests of any type at this local path."""
        return self._claims.of_path(path)

    def application(self, app_id: int) -> AppEntry | None:
        """The application of this id."""
        return self._claims.application(app_id)

    def named(self, name: str) -> AppEntry | None:
        """The first instance of the application of this name."""
        return next((entry for entry in self if entry.name == name), None)


def populated(run_dir: Path) -> bool:
    """Whether an application runs on the node of this run directory; it reads only locks, no content."""
    for path in paths.applications(run_dir).glob(paths.APPLICATION_PATTERN):
        try:
            fd = open_shared(path, limit_bytes=FILE_LIMIT)
        except (OSError, WireError):
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
