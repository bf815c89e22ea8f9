"""The guard's shell: reads application files, heartbeats and process exits, and executes actions."""

import asyncio
from typing import ClassVar

import msgspec

from swarmd.guard import config as settings
from swarmd.guard.core.supervision import (
    Action,
    ClearStartRecord,
    GuardCore,
    Kill,
    ReadHeartbeats,
    ReportRestart,
    Spawn,
    Stop,
    Terminate,
    WatchProcess,
)
from swarmd.guard.priorities import ProcessPriorities
from swarmd.guard.process_supervisor import ProcessSupervisor, SystemdSupervisor
from swarmd.guard.supervisor import InProcessSupervisor, Supervisor
from swarmware.errors import NotFound
from swarmware.model import paths
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.service.exit_status import ExitStatus
from swarmware.service.service import Service
from swarmware.transport.appfile.entry import AppEntry
from swarmware.types.health import (
    UNSTOPPABLE,
    GuardStatus,
    RestartOrder,
    ServiceState,
    StartOrder,
    StopOrder,
    WatchedService,
)
from swarmware.types.rpc import Empty
from swarmware.types.system import AppStatus


class Guard(Service):
    """Keeps the services of node.toml running."""

    name = "guard"
    Config = settings.Config
    config: settings.Config
    stop_s: ClassVar[float] = 25.0
    """Time to stop; longer than for other services, because the guard stops its services one after the
    other."""

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node.config
        names = tuple(name for name in node.services if name != self.name)
        self._node = module.node
        self._table = module.node.table
        self._supervisor = self._choose()
        self._priorities: ProcessPriorities | None = None
        if config.priorities and self._supervisor.kind != InProcessSupervisor.kind:
            self._priorities = ProcessPriorities()
        self._core = GuardCore(names, self._supervisor.kind, config)
        self._driver = self.drive(self._core, self._perform, settled=self._settled)
        self._names = names
        self._stopped = asyncio.Event()
        self._published: GuardStatus | None = None
        self._status_boards = {name: module.reader(paths.status(name), AppStatus) for name in names}
        before = module.reader("guard/status", GuardStatus).value
        # a second guard fails here, because the first one owns the board
        self._board = module.writer(
            "guard/status", GuardStatus, link="notify", description="Services under the guard"
        )
        self._events = module.stream_writer(
            "guard/restarts", WatchedService, kind="event", link="notify", log="all", slots=32, slot_bytes=512
        )
        if before is not None:
            stopped = frozenset(name for name in names if self._supervisor.stays_stopped(name))
            self._core.restore(before, stopped)
        module.serve("sys/guard/status", Empty, self._on_status, reply=GuardStatus)
        module.serve(
            "sys/guard/restart",
            RestartOrder,
            self._on_order,
            reply=GuardStatus,
            description="Restart a service",
        )
        module.serve(
            "sys/guard/stop",
            StopOrder,
            self._on_stop_order,
            reply=GuardStatus,
            description="Stop a service until it is started again",
        )
        module.serve(
            "sys/guard/start",
            StartOrder,
            self._on_start_order,
            reply=GuardStatus,
            description="Start a service that was stopped",
        )

    def _choose(self) -> Supervisor:
        node = self._node
        if node.config.processes == "one" and node.host is not None:
            return InProcessSupervisor(node.host, self._on_exit)
        if self.config.supervisor == "systemd":
            return SystemdSupervisor(node.config_dir, node.run_dir, self._on_exit)
        return ProcessSupervisor(node.config_dir, node.run_dir, self._on_exit)

    async def run(self) -> None:
        """Supervises the services until cancelled."""
        self._table.refresh(probe=True)
        changes = self._node.applications.subscribe(lambda _: self._read_heartbeats())
        # before a service is started, because the next guard restores its counters from this board
        self._publish_status()
        try:
            self._begin()
            await self._driver.run()
        finally:
            changes.close()
            self._supervisor.close()

    async def stop(self) -> None:
        """Stops the started and adopted services, in the reverse order of their start."""
        if not self._supervisor.stops_services:
            return
        self._driver.feed(self._core.on_stop(self.module.now_ns()))
        await self._stopped.wait()

    # -- events

    def _begin(self) -> None:
        running = {entry.name: entry.pid for entry in self._living()}
        starting = {
            name: pid
            for name in self._names
            if name not in running and (pid := self._supervisor.starting_pid(name))
        }
        self._driver.feed(self._core.on_start(running, starting, self.module.now_ns()))
        if running:
            self.module.log.info("found running: %s", ", ".join(running))

    def _living(self) -> list[AppEntry]:
        """Application files of the supervised services whose process is alive."""
        return [entry for entry in self._table if entry.name in self._core and entry.lives]

    def _read_heartbeats(self) -> None:
        """Reads the application files and the heartbeats."""
        self._table.refresh()
        now_ns = self.module.now_ns()
        actions: list[Action] = []
        for entry in self._living():
            actions += self._core.on_joined(entry.name, entry.pid, now_ns)
        statuses: list[tuple[str, AppStatus]] = []
        for name, reader in self._status_boards.items():
            if (status := reader.value) is not None:
                if self._priorities is not None and reader.alive:
                    statuses.append((name, status))
                actions += self._core.on_heartbeat(name, status.beat, now_ns)
                if self._supervisor.kind == InProcessSupervisor.kind:
                    actions += self._core.on_restarted(name, status.restarts, now_ns)
        if self._priorities is not None:
            self._priorities.sample(statuses, now_ns)
        self._driver.feed(actions + self._core.on_heartbeats_read(now_ns))

    def _on_exit(self, name: str, pid: int, how: ExitStatus) -> None:
        self._table.refresh(probe=True)  # otherwise the file of the ended process would be adopted
        self._driver.feed(self._core.on_exit(name, pid, how, self.module.now_ns()))
        self._read_heartbeats()  # the refresh may have found other changes

    # -- actions

    def _perform(self, action: Action) -> None:
        match action:
            case ReadHeartbeats():
                self._read_heartbeats()
            case Spawn(name):
                pid = self._supervisor.spawn(name)
                self._driver.feed(self._core.on_spawned(name, pid, self.module.now_ns()))
            case ClearStartRecord(name):
                self._supervisor.joined(name)
            case WatchProcess(name, pid):
                if not self._supervisor.watch(name, pid, self._started(pid)):
                    # ended before it could be watched, so no exit will be reported
                    self._on_exit(name, pid, ExitStatus())
            case Terminate(name, pid):
                self._supervisor.terminate(name, pid)
            case Stop(name, pid):
                self._supervisor.stop(name, pid)
            case Kill(name, pid, reason):
                self.module.log.warning("%s: killed, pid %d: %s", name, pid, reason)
                self._supervisor.kill(name, pid)
            case ReportRestart(service):
                self._report_restart(service)

    def _started(self, pid: int) -> int:
        """Start time of a process in clock ticks, or 0 if it has no application file."""
        return next((entry.pid_start for entry in self._table if entry.pid == pid), 0)

    def _settled(self) -> None:
        self._publish_status()
        if self._core.stopped:
            self._stopped.set()

    def _report_restart(self, service: WatchedService) -> None:
        self._events.write(service)
        if service.state == ServiceState.FAILED:
            self.module.log.error("%s: %s", service.name, service.reason)
        else:
            self.module.log.warning("%s: %s; restart %d", service.name, service.reason, service.restarts)

    def _status(self) -> GuardStatus:
        """Status of all services, with their priorities."""
        status, priorities = self._core.status(), self._priorities
        if priorities is None:
            return status
        services = []
        for one in status.services:
            nice, cores = priorities.of(one.name)
            services.append(msgspec.structs.replace(one, nice=nice, cores=cores))
        return msgspec.structs.replace(status, services=tuple(services))

    def _publish_status(self) -> None:
        status = self._status()
        if status != self._published:
            self._published = status
            self._board.write(status)

    # -- requests

    def _on_status(self, _: Empty, __: Meta) -> GuardStatus:
        return self._status()

    def _check(self, service: str) -> None:
        if service not in self._core and service not in UNSTOPPABLE:
            raise NotFound(
                f"service {service!r}: not under this guard; expected one of {', '.join(self._names)}"
            )

    def _on_stop_order(self, order: StopOrder, meta: Meta) -> GuardStatus:
        self._check(order.service)
        by = self.module.requester(meta)
        self._driver.feed(self._core.on_stop_order(order.service, by, self.module.now_ns()))
        self.module.log.warning("%s: stopped by %s", order.service, by)
        return self._status()

    def _on_start_order(self, order: StartOrder, meta: Meta) -> GuardStatus:
        self._check(order.service)
        if order.service in self._core:
            self._driver.feed(self._core.on_start_order(order.service, self.module.now_ns()))
            self.module.log.info("%s: started by %s", order.service, self.module.requester(meta))
        return self._status()

    def _on_order(self, order: RestartOrder, _: Meta) -> GuardStatus:
        if order.service not in self._core:
            raise NotFound(
                f"service {order.service!r}: not under this guard; expected one of {', '.join(self._names)}"
            )
        self.module.log.info("%s: restarted on request", order.service)
        self._driver.feed(self._core.on_restart_order(order.service, self.module.now_ns()))
        return self._status()
