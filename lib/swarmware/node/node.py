"""The node, as attached by one of its processes."""

import asyncio
import contextlib
import logging
import os
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final, Protocol, Self
from weakref import WeakSet

from swarmware.errors import InvalidInput, SwarmError
from swarmware.model import paths
from swarmware.model.access_rules import AccessRules
from swarmware.model.clock import Clock, utc_ns
from swarmware.model.config import NodeConfig, find_config_dir, load_node
from swarmware.model.names import Address
from swarmware.node.applications import Applications, Watcher
from swarmware.node.ending import Ending
from swarmware.node.incarnation import NodeIncarnation
from swarmware.node.run_files import Damage, RunFiles, TendFile
from swarmware.runtime.core import next_multiple_ns
from swarmware.runtime.instant import wait_s
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.messaging.callers import Callers
from swarmware.transport.messaging.endpoint import MessageEndpoint
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.layout import ring_file
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.readers import GRANULE_NS

if TYPE_CHECKING:
    from swarmware.node.master.master import Master
    from swarmware.node.publication import Publication

TEND_NS: Final = 1_000_000_000
"""Period in which a process checks that its files in shared memory are intact."""
TEND_PHASE_NS: Final = 300_000_000
"""Phase of that period: an instant of the grid, but not the full second, at which heartbeats and statistics
are written."""
MIRROR_SLOTS: Final = 4
MIRROR_SLOT_BYTES: Final = 256
"""Default slot of a mirror: a header and a packed pose; the ring is replaced when a value is larger."""


_FolderStamp = tuple[int, int]
"""Inode of a folder and time of its last change, which no process can set: with it its files are the same."""

log = logging.getLogger("swarm.node")


class Services(Protocol):
    """The services that run in this process."""

    def restart(self, name: str) -> None:
        """Restart one of the services.

        Raises: NotFound when it does not run in this process.
        """
        ...

    def halt(self, name: str, on_end: Callable[[], None]) -> None:
        """Stop one of the services until `release`; `on_end` is called when it has ended."""
        ...

    def release(self, name: str) -> None:
        """Start a service that was stopped by `halt`."""
        ...

    def halted(self, name: str) -> bool:
        """Whether a service was stopped by `halt`."""
        ...


class Node:
    """State shared by an event loop: configuration, clock, doorbell, message router, applications.

    Modules of one event loop share it: `attach` returns the existing one, and the last `close` closes it.
    Another event loop, in a thread of the same process, has its own.
    """

    # one doorbell and one socket per event loop: the only state per process
    _attached: ClassVar[dict[tuple[int, Path], "Node"]] = {}

    def __init__(self, config_dir: Path, config: NodeConfig) -> None:
        self.config_dir = config_dir
        self.config = config
        self.platform = config.platform
        self.address = Address(config.platform, config.unit)
        self.hardware = self.address.hardware
        self.run_dir = config.run_path
        self.shm_dir = config.shm_path
        self.host: Services | None = None
        """The host of the services of this process; None in a program that has only modules."""
        self._users = 0
        self._watchers: dict[Watcher, None] = {}
        self._listens: Counter[Path] = Counter()
        self._folder = str(self.shm_dir)
        self._folder_ns = -1
        self.ring_changes = 0
        """Number of bells at which the folder of rings had changed: no ring has appeared while it is the
        same."""
        self._errors: list[str] = []
        """Errors of the last check of this process's files."""
        self.repairs = 0
        """Number of checks that found removed or damaged files of this process, and made them again."""
        self.on_damage: Callable[[Damage], None] | None = None
        """Called when files of this process were damaged or removed."""
        self._loop = asyncio.get_running_loop()
        self._incarnation = NodeIncarnation(self.run_dir, self.shm_dir)
        self.clock = Clock(config.clock.offset_s, config.clock.drift_ppm, self._incarnation.boot_id)
        self.started_ns = self.clock.now_ns()
        self.ending = Ending()
        self.table = AppTable(self.run_dir, whole=False)
        self.access_rules = AccessRules(config_dir)
        self.applications = Applications(self.table, self, self.shm_dir, self.run_dir)
        """The applications of this node, with events for subscribers."""
        self.doorbells = DoorbellSenders(paths.doorbells(self.run_dir))
        self.doorbell = Doorbell(paths.doorbells(self.run_dir))
        self.callers = Callers(self.access_rules, self.platform, self.run_dir.stat().st_uid)
        self.messaging = MessageEndpoint(
            platform=self.platform,
            hardware=self.hardware,
            clock=self.clock,
            socket_path=paths.socket(self.run_dir, self.doorbell.name),
            table=self.table,
            callers=self.callers,
        )
        self._apps_watchers = ReaderNotifier(paths.applications_watchers(self.shm_dir), self.doorbells)
        self._mirror_watchers = ReaderNotifier(paths.mirrors_watchers(self.shm_dir), self.doorbells)
        self._publications: WeakSet[Publication] = WeakSet()
        self._folders: dict[str, _FolderStamp | None] = {}
        """Folders of the publications as they were at the last check of their files."""
        self._loop.add_reader(self.doorbell.fd, self._on_bell)
        self._run_files = RunFiles()
        for tend in (self._incarnation.tend, self._tend_doorbell, self.messaging.tend):
            self._run_files.keep(tend)
        self._tending = self._tend_later()
        self._master: Master | None = None

    @classmethod
    def attach(cls, config_dir: Path | str | None = None, config: NodeConfig | None = None) -> Self:
        """Join the node of this configuration folder, or with None of SWARM_CONFIG, else of /etc/swarm.

        Raises: ConfigError, Denied.
        """
        folder = find_config_dir(config_dir)
        key = (id(asyncio.get_running_loop()), folder)
        node = cls._attached.get(key)
        if node is None:
            node = cls._attached[key] = cls(folder, config or load_node(folder))
        node._users += 1
        assert isinstance(node, cls)
        return node

    def share(self) -> Self:
        """Register one more user of this node; each user calls `close`."""
        self._users += 1
        return self

    # -- the role of the master

    def contend(self) -> None:
        """Make this process a candidate for the role of the master, if it is not one yet.

        A client that only reads and requests is not a candidate, and reads the table as far as it needs it.
        """
        self.table.complete()
        if self._master is None:
            from swarmware.node.master.master import Master

            self._master = Master(
                self,
                self.config.unit,
                paths.applications_watchers(self.shm_dir),
                candidate=not self._incarnation.guest,
            )
            self.watch(self._master)
            self._run_files.keep(self._master.tend)

    @property
    def master(self) -> "Master":
        """The candidature of this process.

        Raises: InvalidInput without one.
        """
        if self._master is None:
            raise InvalidInput(f"{self.platform}: no module runs in this process; expected one")
        return self._master

    # -- waking

    def watch(self, watcher: Watcher) -> None:
        """Call the watcher whenever the doorbell rings."""
        # a dict keeps the order of registration, which a set would not
        self._watchers[watcher] = None

    def unwatch(self, watcher: Watcher) -> None:
        """Cancel what `watch` registered."""
        self._watchers.pop(watcher, None)

    def listen(self, readers: Path) -> None:
        """Enter this process's doorbell in a table of readers, once for all callers."""
        self._listens[readers] += 1
        if self._listens[readers] == 1:
            self._enter(readers)

    def _enter(self, readers: Path) -> None:
        with ReaderNotifier(readers, self.doorbells) as bells:
            bells.add(self.doorbell.name)

    def unlisten(self, readers: Path) -> None:
        """Remove the doorbell that `listen` registered."""
        self._listens[readers] -= 1
        if self._listens[readers] <= 0:
            del self._listens[readers]
            with ReaderNotifier(readers, self.doorbells) as bells:
                bells.remove(self.doorbell.name)

    def _on_bell(self) -> None:
        self.doorbell.drain()
        self._look_for_rings()
        # a copy: a watcher may add or remove others
        for watcher in tuple(self._watchers):
            watcher.poll()

    def _look_for_rings(self) -> None:
        """Check the folder once for all watchers that wait for rings, instead of the path of each.

        A mirror, in a folder below, changes the time of this one before its first frame rings.
        """
        try:
            changed_ns = os.stat(self._folder).st_mtime_ns  # noqa: PTH116  # at every bell: no Path object
        except FileNotFoundError:
            changed_ns = -1
        if changed_ns == self._folder_ns:
            return
        self.ring_changes += 1
        # a ring that is made now may leave the time as it is: look again at the next bell
        self._folder_ns = changed_ns if utc_ns() - changed_ns > GRANULE_NS else -1

    @property
    def uptime_s(self) -> float:
        """Time since the start of the node, which a step of the wall clock does not change."""
        return (time.monotonic_ns() - self._incarnation.started_mono_ns) / 1e9

    # -- self-healing

    def _tend_later(self) -> asyncio.TimerHandle:
        next_ns = next_multiple_ns(self.clock.now_ns(), TEND_NS, TEND_PHASE_NS)
        return self._loop.call_later(wait_s(self.clock, next_ns), self._tend)

    def keep_file(self, tend: TendFile) -> None:
        """Have a file of this process in the run directory checked every second, until `release_file`."""
        self._run_files.keep(tend)

    def release_file(self, tend: TendFile) -> None:
        """Cancel what `keep_file` registered."""
        self._run_files.release(tend)

    def _tend(self) -> None:
        """Check and repair the files of this process, which others may have damaged or removed."""
        self._tending = self._tend_later()
        self.access_rules.poll()
        before, self._errors = self._errors, []
        repaired = self._tend_run_files()
        self._tend_publications()
        repaired += self._tend_entries()
        new_errors = [text for text in self._errors if text not in before]
        for text in new_errors:  # once, not every second
            log.error("%s", text)
        if repaired:
            self.repairs += 1
            self._on_bell()  # frames written meanwhile have not rung this doorbell
        if self.on_damage is not None and (repaired or new_errors or (before and not self._errors)):
            self.on_damage(Damage(tuple(repaired), tuple(self._errors)))

    def _tend_run_files(self) -> list[str]:
        repaired, errors = self._run_files.tend()
        self._errors += errors
        for path in repaired:
            log.warning("%s: removed or replaced while the node runs; made again", path)
        return repaired

    def _tend_doorbell(self) -> Path | None:
        if self.doorbell.stands:
            return None
        self._loop.remove_reader(self.doorbell.fd)
        try:
            return self.doorbell.tend()
        finally:
            self._loop.add_reader(self.doorbell.fd, self._on_bell)

    def _tend_publications(self) -> None:
        checked = self._folders
        self._folders = present = dict[str, _FolderStamp | None]()
        for publication in list(self._publications):
            folder = publication.folder
            if folder not in present:
                present[folder] = _stamp(folder)
            stamp = present[folder]
            at_path = stamp is not None and stamp == checked.get(folder)
            try:
                if publication.tend(at_path=at_path):
                    log.warning("%s: damaged or removed; replaced", publication.path)
            except (OSError, SwarmError) as error:
                self._errors.append(
                    f"{publication.path}: damaged or removed, and cannot be replaced: {error}"
                )

    def _tend_entries(self) -> list[str]:
        """Enter our doorbell again in the tables of readers from which it was removed; those tables."""
        name = self.doorbell.name
        missing = [readers for readers in self._listens if not os.access(f"{readers}/{name}", os.F_OK)]
        entered = []
        for readers in missing:
            try:
                self._enter(readers)
            except (OSError, SwarmError) as error:
                self._errors.append(f"{readers}: our entry was removed, and cannot be made again: {error}")
            else:
                log.warning("%s: our entry was removed; entered again", readers)
                entered.append(str(readers))
        return entered

    # -- publication

    def announce_apps(self) -> None:
        """Wake the processes that watch the application files."""
        self._apps_watchers.notify()

    def publication(
        self, path: str, *, slots: int, slot_bytes: int, platform: str | None = None
    ) -> "Publication":
        """The ring of a resource, for writing; of another computer: its mirror.

        Raises: RingBusy when another process writes it.
        """
        from swarmware.node.publication import Publication  # a client writes no ring

        ring = ring_file(self.shm_dir, path, platform)
        readers_of = None
        if platform == self.platform:
            # its readers wait for the ring of this computer; one without a writer would hide the mirror
            from swarmware.transport.shm.reap import reap_ring  # only a tree writes mirrors

            readers_of = ring_file(self.shm_dir, path)
            reap_ring(readers_of)
        made = Publication(ring, self.doorbells, slots=slots, slot_bytes=slot_bytes, readers_of=readers_of)
        self._publications.add(made)
        return made

    def mirror_writer(
        self, platform: str, path: str, *, slots: int = MIRROR_SLOTS, slot_bytes: int = MIRROR_SLOT_BYTES
    ) -> "Publication":
        """The mirror of another computer's resource; frames are published as they were received."""
        publication = self.publication(path, slots=slots, slot_bytes=slot_bytes, platform=platform)
        now_ns = utc_ns()
        os.utime(self.shm_dir, ns=(now_ns, now_ns))  # `BoardSet` checks this time
        self._mirror_watchers.notify()
        return publication

    def close(self) -> None:
        """Release this use of the node; the last user in this process leaves it."""
        self._users -= 1
        if self._users > 0:
            return
        self._attached.pop((id(self._loop), self.config_dir), None)
        if self._master is not None:
            self.unwatch(self._master)
            self._master.close()
        for readers in list(self._listens):
            self._listens[readers] = 1
            self.unlisten(readers)
        self._tending.cancel()
        self._loop.remove_reader(self.doorbell.fd)
        self.messaging.close()
        self.callers.close()
        self._apps_watchers.close()
        self._mirror_watchers.close()
        self.doorbell.close()
        self.doorbells.close()
        with contextlib.suppress(FileNotFoundError):
            self._incarnation.leave()


def _stamp(folder: str) -> _FolderStamp | None:
    """Stamp of a folder, or None if it is missing or may change again without a new time."""
    try:
        found = os.stat(folder)  # noqa: PTH116  # every second: no Path object
    except OSError:
        return None
    return (found.st_ino, found.st_ctime_ns) if utc_ns() - found.st_ctime_ns > GRANULE_NS else None
