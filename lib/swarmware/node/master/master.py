"""The master's task: publishes the register of this computer, and removes files of dead applications."""

import asyncio
import logging
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, Protocol

import msgspec

from swarmware.errors import Conflict, Denied, WireError
from swarmware.model import paths
from swarmware.model.clock import Clock
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import ANY, MAIN, application_id, data_id, has_unit_branch
from swarmware.model.resource import Resource
from swarmware.node.master.record import NO_HOLDER, Holder
from swarmware.node.master.role import LeaderCandidate
from swarmware.runtime.pidfd import start_ticks
from swarmware.runtime.processes import ProcessWatcher
from swarmware.transport.appfile.entry import FILE_LIMIT, AppEntry
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.appfile.trace import set_aside
from swarmware.transport.shm.doorbell import DoorbellSenders, folder_lock
from swarmware.transport.shm.lock import stands_at, try_lock
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.shared_file import discard, open_shared
from swarmware.types import registry
from swarmware.types.register import Application, ApplicationTable

PATH: Final = "register/apps"
APPLICATIONS_LIMIT: Final = 64
"""Maximum applications in the table, three times the usual number: the board stays below 3 kB."""
NAMED_LIMIT: Final = 256
"""Maximum lines that are remembered as logged."""
PAUSE_S: Final = 1.0
"""Minimum time between two tables: the start of twelve services is one or two changes, not twelve."""
BUSY_S: Final = 0.01
"""Pause before a retry while the former master is still closing the board."""

log = logging.getLogger("swarm.master")

RESOURCE: Final = Resource(
    path=PATH,
    type=registry.type_name(ApplicationTable),
    link="notify",
    owner="register",
    description="Applications of this computer, published by its master",
)


class Board(Protocol):
    """Interface of the board with the table: a `Publication`."""

    @property
    def sequence(self) -> int: ...
    def publish(self, data: bytes) -> int: ...
    def close(self, *, unlink: bool = True) -> None: ...


class NodeServices(Protocol):
    """Interface of the node that the master uses."""

    run_dir: Path
    shm_dir: Path
    platform: str
    hardware: int
    clock: Clock
    doorbells: DoorbellSenders
    table: AppTable

    def listen(self, readers: Path) -> None: ...
    def unlisten(self, readers: Path) -> None: ...
    def publication(self, path: str, *, slots: int, slot_bytes: int) -> Board: ...
    def announce_apps(self) -> None: ...


class Master:
    """The candidature of this process; a watcher of the node: `poll` when the doorbell has rung.

    `apps_table`: the doorbells that are rung when applications join, leave or change. A process that is not a
    `candidate`, because the node belongs to another user, never gets the role and does not know its holder.
    """

    def __init__(self, node: NodeServices, unit: str, apps_table: Path, *, candidate: bool = True) -> None:
        self._node = node
        self._unit = unit
        self._apps_table = apps_table
        self._master_table = paths.master_watchers(node.shm_dir)
        self._bells = ReaderNotifier(self._master_table, node.doorbells)
        self._loop = asyncio.get_running_loop()
        self._apps = node.table
        self._apps_version = -1
        self._board: Board | None = None
        self._listening = False
        self._processes = ProcessWatcher(self._died)
        self._watched: dict[str, int] = {}
        self._epoch = 0
        """Fencing number for which `_version` counts."""
        self._version = 0
        self._timer: asyncio.TimerHandle | None = None
        self._published_s = -PAUSE_S
        self._published: tuple[int, str, tuple[Application, ...], int] | None = None
        """Content of the last table of this holder."""
        self._rejections: tuple[str, ...] = ()
        """Errors in the application files at the last refresh, a line each."""
        self._named: set[str] = set()
        """Lines that were logged: a file that comes again and again is named once."""
        self.on_rejections: Callable[[tuple[str, ...]], None] | None = None
        """Called when that has changed, while this process is the master."""
        self._role: LeaderCandidate | None = None
        if candidate:
            self._role = LeaderCandidate(
                node.run_dir,
                f"pid {os.getpid()}",
                ring=self._bells.notify,
                on_gained=self._gained,
                on_lost=self._lost,
            )
            node.listen(self._master_table)
            self._role.start()

    @property
    def holder(self) -> Holder:
        """The process that is the master."""
        return NO_HOLDER if self._role is None else self._role.holder

    def volunteer(self, label: str) -> None:
        """Request the role for this process, which runs the register daemon.

        Raises: Denied when the node belongs to another user.
        """
        if self._role is None:
            raise Denied(f"{self._node.run_dir}: of another user; expected {label} to run as its owner")
        self._role.volunteer(label)

    def step_back(self) -> None:
        """Contend for the role as any other process: the register daemon of this process has ended."""
        if self._role is not None:
            self._role.step_back(f"pid {os.getpid()}")

    def tend(self) -> Path | None:
        """Make the file of the role again if it was removed; its path, or None if it stands.

        While this process is the master, it also removes files that are none and names what it found.
        Raises: OSError.
        """
        if self._role is None:
            return None
        if self._role.holding:
            self._apps.refresh()
            self._on_rejections()
        return self._role.tend()

    def _on_rejections(self) -> None:
        rejections = self._apps.rejections
        if rejections == self._rejections:
            return
        self._rejections = rejections
        if len(self._named) > NAMED_LIMIT:
            self._named.clear()
        for text in rejections:
            if text not in self._named:
                self._named.add(text)
                log.warning("applications: %s", text)
        if self.on_rejections is not None:
            self.on_rejections(rejections)
        self._tidy()

    def poll(self) -> None:
        """The doorbell has rung."""
        if self._role is None:
            return
        self._role.poll()
        if self._role.holding:
            self._apps.refresh()
            if self._apps.version != self._apps_version:
                self._changed()

    def table(self, *, full: bool) -> ApplicationTable:
        """The register of this computer; `full`: with endpoints and served paths, which are not published.

        A unit that is not `main` publishes the served paths by which it is found.
        """
        self._apps.refresh()
        entries = list(self._apps)
        holder = self.holder
        return ApplicationTable(
            platform=self._node.platform,
            unit=self._unit,
            boot_id=self._node.clock.boot_id,
            epoch=holder.epoch,
            version=self._version,
            master=holder.label,
            stamp_ns=self._node.clock.now_ns(),
            applications=tuple(
                _application(entry, full=full, is_unit=self._unit != MAIN)
                for entry in entries[:APPLICATIONS_LIMIT]
            ),
            omitted=max(0, len(entries) - APPLICATIONS_LIMIT),
        )

    def close(self) -> None:
        """Release the role of the master."""
        if self._role is not None:
            self._role.close()
            self._node.unlisten(self._master_table)
        self._bells.close()

    # -- while this process is the master

    def _gained(self, epoch: int) -> None:
        if not self._listening:
            self._listening = True
            self._node.listen(self._apps_table)
        if epoch != self._epoch:  # the holder that volunteers continues its count
            self._epoch = epoch
            self._version = 0
        self._published_s = -PAUSE_S
        self._apps.refresh(probe=True)
        self._tidy()
        self._changed()

    def _lost(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._processes.close()
        self._listening = False
        self._node.unlisten(self._apps_table)
        self._published = None
        if self._board is not None:
            # the table stays readable until the next master replaces it
            self._board.close(unlink=False)
            self._board = None

    def _changed(self) -> None:
        self._apps_version = self._apps.version
        self._watched = {entry.id: entry.pid for entry in self._apps}
        self._processes.watch(set(self._watched.values()))
        if self._timer is None:
            wait_s = self._published_s + PAUSE_S - self._loop.time()
            self._timer = self._loop.call_later(max(0.0, wait_s), self._publish)

    def _publish(self) -> None:
        self._timer = None
        if self._board is None:
            try:
                self._board = self._node.publication(PATH, slots=4, slot_bytes=2048)
            except Conflict:
                self._timer = self._loop.call_later(BUSY_S, self._publish)
                return
        # also for a table without a change, which was computed all the same
        self._published_s = self._loop.time()
        table = self.table(full=False)
        content = (table.epoch, table.master, table.applications, table.omitted)
        if content == self._published:
            return  # an application reads or serves something else, which is not published
        self._published = content
        self._version += 1
        table = msgspec.structs.replace(table, version=self._version)
        frame = Frame(
            FrameKind.BOARD,
            data_id(PATH, registry.type_name(ApplicationTable)),
            self._node.hardware,
            application_id("register", 1),
            ANY,
            ANY,
            self._board.sequence + 1,
            table.stamp_ns,
            payload=registry.encode(table),
        )
        self._board.publish(encode(frame))

    def _died(self, pid: int) -> None:
        died = [app_id for app_id, owner in self._watched.items() if owner == pid]
        self._apps.refresh(probe=True)
        if self._tidy():
            log.info("died without leaving: %s", ", ".join(died))
        self._remove_traces(pid)
        self._changed()

    def _remove_traces(self, pid: int) -> None:
        """Remove its socket and doorbells, so that restarts over months do not fill the folders."""
        if start_ticks(pid):
            return  # the pid belongs to a new process already
        for path in paths.sockets_of(self._node.run_dir, pid):
            discard(path)
        bells = paths.doorbells(self._node.run_dir)
        with suppress(Conflict, FileNotFoundError), folder_lock(bells):
            for path in bells.glob(f"{pid}-*"):
                discard(path)

    def _tidy(self) -> bool:
        """Rename the files of dead applications, and remove anything else among them; True when there
        were some."""
        removed = False
        for path in paths.applications(self._node.run_dir).glob(paths.APPLICATION_PATTERN):
            try:
                fd = open_shared(path, limit_bytes=FILE_LIMIT)
            except WireError:
                removed = discard(path) or removed
                continue
            except OSError:
                continue  # removed meanwhile
            try:
                # the lock shows that its application is dead; the path, that no other has taken it over
                if try_lock(fd) and stands_at(fd, path):
                    set_aside(path)
                    removed = True
            finally:
                os.close(fd)
        if removed:
            self._node.announce_apps()
        return removed


def _application(entry: AppEntry, *, full: bool, is_unit: bool) -> Application:
    serves = (served.path for served in entry.serves if full or not has_unit_branch(served.path))
    return Application(
        name=entry.name,
        instance=entry.instance,
        pid=entry.pid,
        started_ns=entry.started_ns,
        endpoint=entry.endpoint if full else "",
        provides=len(entry.provides),
        serves=tuple(serves) if full or is_unit else (),
    )
