"""The monitor's shell: reads shared memory, watches processes, publishes state and faults."""

import asyncio
import signal
from contextlib import closing, suppress
from typing import Any

from swarmd.health import config as settings
from swarmd.health.core.apps import DIED
from swarmd.health.core.monitor import (
    GUARD,
    Action,
    FaultChanged,
    FaultsCleared,
    GuardHung,
    MonitorCore,
    ReadInputs,
    RegistrationChanged,
    RunningApp,
)
from swarmd.health.journal import JournalFile
from swarmd.health.readiness_board import ReadinessBoard
from swarmware.errors import NotFound, SwarmError
from swarmware.health.monitor import ADDRESS
from swarmware.model import paths, template
from swarmware.model.names import Pattern
from swarmware.model.platform_kind import VEHICLES, PlatformKind
from swarmware.module.board import BoardReader
from swarmware.module.inbox import Inbox
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.node.applications import ApplicationEvent, Change
from swarmware.runtime.pidfd import ProcessHandle
from swarmware.runtime.processes import ProcessWatcher
from swarmware.service.service import Service
from swarmware.transport.appfile.entry import AppEntry
from swarmware.transport.appfile.trace import died
from swarmware.types import registry
from swarmware.types.health import (
    CheckRegistration,
    CheckReports,
    Fault,
    FaultClear,
    FaultList,
    FaultQuery,
    GuardStatus,
    HealthReport,
    HealthState,
    Phase,
    ServiceState,
)
from swarmware.types.net import Routes
from swarmware.types.rpc import Empty
from swarmware.types.system import AppState, AppStatus

ROUTES_S = 5.0
"""Maximum age of the table of routes, which is written every second."""
ENDING = frozenset({ServiceState.STOPPING, ServiceState.STOPPED})
"""States of a service in the guard's board that mean that the node stops."""


class Health(Service):
    """Monitors the platform and publishes its state; the guard is the only process on which it acts
    (S1.28)."""

    name = "health"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node
        self._core = MonitorCore(config)
        self._driver = self.drive(self._core, self._perform, settled=self._publish)
        self._read_request: asyncio.Queue[ReadInputs] = asyncio.Queue(1)
        self._unannounced: list[Fault] = []
        """Changes of faults that are not yet in the journal, and so not announced."""
        self._unsaved = False
        self._entries: dict[str, AppEntry] = {}
        self._types: dict[str, str] = {}
        self._boards: dict[str, BoardReader[Any]] = {}
        self._boards_of: tuple[int, int, int] | None = None
        """Version of the applications and numbers of rules for which the readers were opened."""
        self._report_positions: dict[str, int] = {}
        self._process_watcher = ProcessWatcher(self._on_death)
        self._journal = JournalFile(node.config.data_path / "health", node.clock.boot_id)
        self._guard_board = module.reader("guard/status", GuardStatus)
        patterns = config.platforms
        if patterns is None:
            patterns = ("*",) if node.config.kind == PlatformKind.GCS else ()
        self._required_platforms = [Pattern(text) for text in patterns]
        self._routes = module.reader("net/routes", Routes) if self._required_platforms else None
        """Routes to other platforms, or None if no platform is required."""
        self._readiness = ReadinessBoard(module, self._core) if node.config.kind in VEHICLES else None
        self._published: HealthState | None = None
        self._board = module.writer(
            "health/state", HealthState, link="notify", log="all", description="Logical system state"
        )
        self._events = module.stream_writer(
            "health/faults",
            Fault,
            kind="event",
            link="notify",
            log="all",
            slots=64,
            slot_bytes=512,
            description="Each change of a fault",
        )
        module.serve("sys/health/state", Empty, self._on_state, reply=HealthReport)
        module.serve("sys/health/faults", FaultQuery, self._on_faults, reply=FaultList)
        module.serve(
            "sys/health/clear",
            FaultClear,
            self._on_clear,
            reply=FaultList,
            description="Clear faults that match a pattern",
        )
        self._registrations: Inbox[CheckRegistration] = module.inbox(
            ADDRESS, CheckRegistration, description="Registers a check of a module"
        )

    async def run(self) -> None:
        """Runs the monitor until cancelled."""
        node = self.module.node
        self._load_template()
        journal = self._journal.load()
        self._driver.feed(self._core.on_start(journal.registrations, journal.faults, self.module.now_ns()))
        changes = node.applications.subscribe(self._on_applications)
        try:
            self._on_applications([ApplicationEvent(Change.JOINED, entry) for entry in node.table])
            async with asyncio.TaskGroup() as group:
                group.create_task(self._driver.run(), name="health: driver")
                group.create_task(self._read_inputs(), name="health: look")
                group.create_task(self._take_registrations(), name="health: registrations")
        finally:
            changes.close()
            self._process_watcher.close()

    def _load_template(self) -> None:
        node = self.module.node.config
        try:
            found = template.load(node.template, node.share_path / "templates")
        except SwarmError as error:
            self.module.log.warning("template: %s; sensors are monitored when they appear", error)
            return
        self._core.set_template(found.resources)

    def _node_stops(self) -> bool:
        """True if the node stops, when a stale resource of a stopped service is not a fault."""
        status = self._guard_board.value
        return status is not None and any(
            # a service that an operator stopped does not mean that the node stops
            one.state in ENDING and not one.stopped_by
            for one in status.services
        )

    # -- applications

    def _on_applications(self, events: list[ApplicationEvent]) -> None:
        now_ns = self.module.now_ns()
        actions: list[Action] = []
        for change, entry in events:
            if change in {Change.LEFT, Change.DIED}:
                known = self._entries.get(entry.id)
                if known is not None and known.pid == entry.pid:  # otherwise its end was handled before
                    actions += self._on_end(entry, now_ns)
            else:
                self._entries[entry.id] = entry
                self._types |= {one.path: one.type for one in entry.provides}
                found = RunningApp(entry.id, entry.name, entry.pid, entry.started_ns, entry.provides)
                actions += self._core.on_running(found, now_ns)
        # a pidfd reports a death within milliseconds
        self._process_watcher.watch({entry.pid for entry in self._entries.values()})
        self._driver.feed(actions)

    def _on_death(self, pid: int) -> None:
        """Takes the end of a process; its applications that did not leave the node have died."""
        now_ns = self.module.now_ns()
        entries = [entry for entry in self._entries.values() if entry.pid == pid]
        self._driver.feed([action for entry in entries for action in self._on_end(entry, now_ns)])

    def _on_end(self, entry: AppEntry, now_ns: int) -> list[Action]:
        """Takes the end of an application, which left the node if it removed its file or announced its
        stop."""
        del self._entries[entry.id]
        status = self._status(entry.name)
        announced = status is not None and status.pid == entry.pid and status.state is AppState.STOPPING
        if announced or not died(self.module.node.run_dir, entry):
            return self._core.on_left(entry.id, now_ns)
        return self._core.on_died(entry.id, now_ns)

    # -- inputs

    async def _read_inputs(self) -> None:
        while True:
            look = await self._read_request.get()
            self.module.node.applications.refresh()
            self._open_boards()
            now_ns = self.module.now_ns()
            actions = self._read_applications(now_ns)
            for age in self._core.ages() if not self._node_stops() else ():
                if (board := self._boards.get(age.path)) is not None:
                    actions += self._core.on_age_sample(age, board.position, now_ns)
            if look.values:
                actions += self._read_values(now_ns)
            actions += self._read_reports(now_ns)
            actions += self._read_routes(now_ns)
            self._driver.feed(actions + self._core.on_inputs_read(now_ns))
            if self._readiness is not None:
                self._readiness.update(now_ns)

    def _open_boards(self) -> None:
        """Opens a reader for each monitored resource, when the resources may have changed."""
        found = (self.module.node.table.version, len(self._core.ages()), len(self._core.limits()))
        if found == self._boards_of:
            return
        self._boards_of = found
        wanted = {age.path for age in self._core.ages()} | {rule.path for rule in self._core.limits()}
        for entry in self._entries.values():
            wanted.add(paths.status(entry.name))
            wanted |= {one.path for one in entry.provides if one.type == CheckReports.__name__}
        for path in wanted - self._boards.keys():
            try:
                cls = registry.find(self._types.get(path, AppStatus.__name__))
            except NotFound:
                cls = Empty  # a type that only its owner knows; its age can still be monitored
            self._boards[path] = self.module.reader(path, cls)
        for path in self._boards.keys() - wanted:
            self._boards.pop(path).close()

    def _status(self, name: str) -> AppStatus | None:
        board = self._boards.get(paths.status(name))
        value = None if board is None else board.value
        return value if isinstance(value, AppStatus) else None

    def _read_applications(self, now_ns: int) -> list[Action]:
        return [
            action
            for app in self._core.apps
            if app.state != DIED and (status := self._status(app.name)) is not None
            for action in self._core.on_status(app, status, now_ns)
        ]

    def _end_guard(self, pid: int) -> None:
        """Kills a guard without a heartbeat; any daemon restarts it. Only SIGKILL ends a stopped process."""
        node = self.module.node
        entry = next((one for one in self._entries.values() if (one.name, one.pid) == (GUARD, pid)), None)
        if entry is None or entry.config.get("supervisor", "self") != "self":
            return  # ended already, or restarted by another supervisor
        if self.config.restart_guard and node.config.processes == "per-daemon":
            self.module.log.warning("guard: no heartbeat, pid %d is killed", pid)
            with suppress(ProcessLookupError), closing(ProcessHandle(pid, entry.pid_start)) as guard:
                guard.signal(signal.SIGKILL)

    def _read_values(self, now_ns: int) -> list[Action]:
        actions: list[Action] = []
        for rule in self._core.limits():
            board = self._boards.get(rule.path)
            value = None if board is None else board.value
            field = getattr(value, rule.field, None)
            if isinstance(field, int | float):
                actions += self._core.on_value(rule, float(field), now_ns)
        return actions

    def _read_reports(self, now_ns: int) -> list[Action]:
        actions: list[Action] = []
        for path, board in self._boards.items():
            if self._types.get(path) != CheckReports.__name__:
                continue
            position = board.position
            if position != self._report_positions.get(path):
                self._report_positions[path] = position
                if (reports := board.value) is not None:
                    actions += self._core.on_reports(reports, now_ns)
        return actions

    def _read_routes(self, now_ns: int) -> list[Action]:
        if self._routes is None or (routes := self._routes.value) is None or self._node_stops():
            return []
        age_s = self._routes.age_s
        # old routes would make all platforms look reachable
        if age_s is None or age_s > ROUTES_S:
            return []  # the broker is not running, which is a fault of its own
        reached = {route.platform for route in routes.routes}
        wanted = {one for one in reached if any(pattern.matches(one) for pattern in self._required_platforms)}
        return self._core.on_platforms(wanted - {self.module.platform}, now_ns)

    # -- publication

    async def _take_registrations(self) -> None:
        async for registration in self._registrations:
            self._driver.feed(self._core.on_registration(registration, self.module.now_ns()))

    def _perform(self, action: Action) -> None:
        match action:
            case ReadInputs():
                if self._read_request.empty():
                    # a request that is still waiting covers this one
                    self._read_request.put_nowait(action)
            case FaultChanged(fault):
                self._unannounced.append(fault)
                self._unsaved = True
            case RegistrationChanged(registration):
                self._unsaved = True
                self.module.log.info(
                    "check %s of %s: %s",
                    registration.check,
                    registration.app,
                    "withdrawn" if registration.withdrawn else f"{registration.frequency_hz:g} Hz",
                )
            case FaultsCleared():
                self._unsaved = True
            case GuardHung(pid):
                self._end_guard(pid)

    def _publish(self) -> None:
        """Publishes changed faults as events, and the state if it changed."""
        now_ns = self.module.now_ns()
        if self._unsaved:
            self._unsaved = False
            self._save()  # first, because an announced fault must be restored after a kill
        changed, self._unannounced = self._unannounced, []
        for fault in changed:
            self._events.write(fault, now_ns)
            level = self.module.log.warning if fault.phase is Phase.CONFIRMED else self.module.log.info
            level("%s: %s %s (%s)", fault.check, fault.state, fault.phase, fault.freeze)
        state = self._core.state()
        if state != self._published:
            self._published = state
            self._board.write(state, now_ns)

    def _save(self) -> None:
        try:
            self._journal.save(self._core.reports.registrations(), self._core.faults.open())
        except OSError as error:
            self.module.log.error("journal: %s; after a kill registrations would be missing", error)

    def _on_state(self, _: Empty, __: Meta) -> HealthReport:
        return HealthReport(
            self.module.platform, self.module.now_ns(), self._core.state(), self._core.checks()
        )

    def _on_clear(self, order: FaultClear, meta: Meta) -> FaultList:
        now_ns = self.module.now_ns()
        actions = self._core.on_clear(order.pattern, now_ns)
        cleared = [
            fault for action in actions if isinstance(action, FaultsCleared) for fault in action.faults
        ]
        self.module.log.info("faults cleared on request (%s): %d", order.pattern, len(cleared))
        self._driver.feed(actions)
        return FaultList(self.module.platform, now_ns, tuple(cleared))

    def _on_faults(self, query: FaultQuery, _: Meta) -> FaultList:
        faults = self._core.faults.open()
        if query.cleared:
            faults += self._core.faults.cleared()
        return FaultList(self.module.platform, self.module.now_ns(), faults)
