"""The services of one process: each is restarted when it fails, without effect on the others."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, Self

import msgspec

from swarmware.errors import NotFound, SwarmError, reason
from swarmware.health.held_condition import HeldCondition
from swarmware.health.monitor import HealthMonitor
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.node.run_files import Damage
from swarmware.runtime.backoff import RestartPolicy
from swarmware.service.installed import find, load_config
from swarmware.service.live_config import overridden
from swarmware.service.realtime import give_realtime
from swarmware.service.service import Service
from swarmware.service.status import Reporter, beat
from swarmware.types.health import OK_STATE
from swarmware.types.system import AppState

BACKOFF_S: Final = (0.0, 0.1, 0.5, 1.0, 2.0, 5.0)
"""Pause before the n-th restart in a row of a service that fails at its start; the last one from then on."""
SAME_ERRORS: Final = 5
"""Consecutive failures of a service by one error after which its restarts are logged at DEBUG only."""

NAMED: Final = 3
"""Paths that a fault names; the log has all."""
REPORTER: Final = "guard"
"""Service that reports conditions of its whole process; the first one, in a process without it."""
UNSUPERVISED: Final = (
    "the parent of this process has ended or hangs, and restarts nothing; expected it to run:"
    " start the node again, which takes over what runs"
)

log = logging.getLogger("swarm.host")


class PreparedService(msgspec.Struct, frozen=True):
    """A service that can be started: its class was found and its configuration is valid."""

    cls: type[Service]
    config: msgspec.Struct
    config_dir: Path | None = None
    """Folder of its file, which is read again at each further start, or None to keep the configuration."""

    @classmethod
    def of(cls, name: str, config_dir: Path) -> Self:
        """The service of this name.

        Raises: NotFound for a name that is not installed, ConfigError when its file is invalid.
        """
        found = find(name)
        return cls(found, load_config(found, config_dir), config_dir)

    def reloaded(self) -> PreparedService:
        """The service with the present content of its file. Raises: ConfigError."""
        if self.config_dir is None:
            return self
        config = load_config(self.cls, self.config_dir)
        return PreparedService(self.cls, config, self.config_dir)

    @property
    def name(self) -> str:
        """Name of the service."""
        return self.cls.name


class Halt:
    """A request to stop one service; it is not started again before `released`."""

    def __init__(self, on_end: Callable[[], None]) -> None:
        self.on_end = on_end
        self.released = asyncio.Event()


class ServiceEnded(SwarmError):
    """`run` of a service returned without a request to stop."""


class ServiceHost:
    """Runs services in this process.

    One of several services that fails is restarted here; a single one ends the process, which its
    supervisor restarts.
    """

    def __init__(self, node: Node, prepared: list[PreparedService]) -> None:
        self.node = node
        self._prepared = {item.name: item for item in prepared}
        self._running: dict[str, Service] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._again: set[str] = set()
        self._failed: set[str] = set()
        self._halts: dict[str, Halt] = {}
        self._ending: set[asyncio.Task[None]] = set()
        self._started: dict[str, asyncio.Event] = {name: asyncio.Event() for name in self._prepared}
        self._reporters: dict[str, Reporter] = {}
        self._no_realtime = ""
        """Reason for which declared real-time scheduling is not in force, or ""."""
        self._supervised = True

    @property
    def names(self) -> list[str]:
        """Names of the services, in the order of their start."""
        return list(self._prepared)

    @property
    def stop_s(self) -> float:
        """Largest stop time of the services."""
        return max((item.cls.stop_s for item in self._prepared.values()), default=0.0)

    @property
    def failed(self) -> list[str]:
        """Names of the services that have failed and do not run at present."""
        return [name for name in self._prepared if name in self._failed]

    async def started(self) -> None:
        """Return when every service has run up to its first wait."""
        for event in self._started.values():
            await event.wait()

    async def run(self) -> None:
        """Run until cancelled. Raises: ServiceEnded, or what a single service raised."""
        self._no_realtime = give_realtime(self.node.config.realtime, self.names)
        if self._no_realtime:
            log.warning("real-time scheduling: %s", self._no_realtime)
        async with asyncio.TaskGroup() as group:
            for item in self._prepared.values():
                group.create_task(self._keep(item), name=f"keep:{item.name}")
            group.create_task(beat(self.node.clock, lambda: tuple(self._reporters.values())), name="beat")

    def restart(self, name: str) -> None:
        """Cancel a service and start it again at once.

        Raises: NotFound if no such service runs in this process.
        """
        task = self._tasks.get(name)
        if task is None:
            raise NotFound(f"service {name!r}: not in this process; expected one of {', '.join(self._tasks)}")
        # A requested cancellation; without this mark `_run_once` treats it as the end of the service.
        self._again.add(name)
        task.cancel()

    def halt(self, name: str, on_end: Callable[[], None]) -> None:
        """Stop a service until `release`; `on_end` is called when it has ended."""
        if name in self._halts:
            return
        self._halts[name] = Halt(on_end)
        if (task := self._tasks.get(name)) is not None and name in self._running:
            ending = asyncio.get_running_loop().create_task(self._halt(name, task), name=f"halt:{name}")
            self._ending.add(ending)
            ending.add_done_callback(self._ending.discard)

    async def _halt(self, name: str, task: asyncio.Task[None]) -> None:
        await self._stop_one(name)
        task.cancel()

    def halted(self, name: str) -> bool:
        """Whether a service was stopped by `halt` and not released."""
        return name in self._halts

    def release(self, name: str) -> None:
        """Start a service that was stopped by `halt`; nothing happens to another."""
        if (halt := self._halts.pop(name, None)) is not None:
            halt.released.set()

    def on_supervised(self, supervised: bool) -> None:
        """Report whether the parent of this process receives its heartbeats; the services run on without it.

        A vehicle in the air needs its services more than they need the process that restarts them.
        """
        if supervised == self._supervised:
            return
        self._supervised = supervised
        if supervised:
            log.info("supervised again")
        else:
            log.warning("%s", UNSUPERVISED)
        if (service := self._running.get(self._speaker)) is not None:
            self._report_supervision(service)

    @property
    def _speaker(self) -> str:
        """The service that reports a condition of the whole process."""
        return REPORTER if REPORTER in self._prepared else self.names[0]

    def _report_supervision(self, service: Service) -> None:
        service.health.report(
            "supervisor",
            OK_STATE if self._supervised else "missing",
            level=None if self._supervised else "warn",
            detail="" if self._supervised else UNSUPERVISED,
            clear_s=0.0,
            description="The process that restarts the processes of the node runs",
        )

    async def stop(self) -> None:
        """Stop every service, the last started first."""
        for name in reversed(self.names):
            await self._stop_one(name)

    async def _stop_one(self, name: str) -> None:
        service = self._running.get(name)
        if service is None:
            return
        service.module.keep_boards(False)
        if reporter := self._reporters.get(name):
            reporter.state = AppState.STOPPING
            reporter.report()  # it leaves the node in order, so it must not count as died
        try:
            await asyncio.wait_for(service.stop(), service.stop_s)
        except TimeoutError:
            log.warning("%s: did not finish within %s s", name, service.stop_s)
        except Exception:
            log.exception("%s: failed while stopping", name)

    async def _keep(self, item: PreparedService) -> None:
        alone = len(self._prepared) == 1
        # No limit of restarts: the process must not end because of one of its services.
        policy = RestartPolicy(pauses_s=BACKOFF_S, limit=0)
        failures = same = 0
        logged: str | None = None
        while True:
            if (halt := self._halts.get(item.name)) is not None:
                log.info("%s: stopped on request", item.name)
                halt.on_end()
                await halt.released.wait()
            try:
                await self._run_once(item, policy, failures)
            except Exception as error:
                if alone:
                    raise
                failures += 1
                self._failed.add(item.name)
                self._started[item.name].set()  # it counts as started, so that the others do not wait for it
                text = reason(error)
                if text is None:
                    log.error("%s: failed: %s", item.name, error, exc_info=error)
                elif text != logged:  # once: the same error returns at each start
                    log.error("%s: failed: %s", item.name, text)
                same = same + 1 if text == logged else 1
                logged = text
                level = logging.WARNING if same <= SAME_ERRORS else logging.DEBUG
            else:  # on request
                level, logged, same = logging.INFO, None, 0
                policy.reset()
            if item.name in self._halts:
                continue
            pause_s = policy.on_end(time.monotonic_ns()) or 0.0
            log.log(level, "%s: starts again in %s s (restart %d)", item.name, pause_s, policy.restarts)
            # after the log line, which states the pause
            await asyncio.sleep(pause_s)
            try:
                item = item.reloaded()
            except SwarmError as error:  # a mistake in the file does not stop a vehicle that moves
                log.error("%s: starts with its former configuration: %s", item.name, error)

    async def _run_once(self, item: PreparedService, policy: RestartPolicy, failures: int) -> None:
        live = item.cls.live_settings
        async with Module(item.name, node=self.node, config=item.config, live_settings=live) as module:
            module.keep_boards()  # readable while the service restarts; `stop` undoes this
            service = item.cls(module, overridden(item.config, live, self.node.config.data_path))
            reporter = self._reporters[item.name] = Reporter.open(module, policy.restarts, failures)
            # Before `run`, so that a stop during the start finds the service.
            self._running[item.name] = service
            damage_report = DamageReport(service.health)
            if item.name == self._speaker:
                self.node.on_damage = damage_report.on_damage
            if self._no_realtime and item.name in self.node.config.realtime.services:
                service.health.report(
                    "realtime",
                    "refused",
                    level="error" if self.node.config.realtime.required else "warn",
                    detail=self._no_realtime,
                    description="The service has the real-time scheduling that node.toml declares",
                )
            if not self._supervised and item.name == self._speaker:
                self._report_supervision(service)
            task = asyncio.create_task(service.run(), name=f"run:{item.name}")
            self._tasks[item.name] = task
            try:
                await asyncio.sleep(0)
                if task.done():
                    await task  # it failed at once: do not report it as running
                reporter.state = AppState.RUNNING
                reporter.report()  # before the next heartbeat
                policy.on_ready(time.monotonic_ns())
                self._failed.discard(item.name)
                self._started[item.name].set()
                await asyncio.wait([task])
                if not (task.cancelled() and (item.name in self._again or item.name in self._halts)):
                    await task
                    raise ServiceEnded(
                        f"service {item.name}: run() returned; expected it to run until it is cancelled"
                    )
            finally:
                if item.name == self._speaker:
                    self.node.on_damage = None
                damage_report.close()
                self._again.discard(item.name)
                self._reporters.pop(item.name, None)
                await _ended(task)
                self._running.pop(item.name, None)


async def _ended(task: asyncio.Task[None]) -> None:
    """Cancel the task and wait for its end; its error was logged."""
    if not task.done():
        task.cancel()
    await asyncio.wait([task])


class DamageReport:
    """The condition `files` of one service, which reports for its process."""

    def __init__(self, monitor: HealthMonitor) -> None:
        self._condition = HeldCondition(
            monitor, "files", "Files of this process in the run directory and in shared memory are its own"
        )

    def on_damage(self, damage: Damage) -> None:
        """Report what was found; files that were made again are a warning for a while."""
        if damage.errors:
            self._condition.raise_fault("lost", "error", _shown(damage.errors))
            return
        if damage.repaired:
            text = f"removed while the node ran, and made again: {_shown(damage.repaired)}"
            self._condition.raise_fault("restored", "warn", text)
        self._condition.clear()

    def close(self) -> None:
        """End the report with its service."""
        self._condition.close()


def _shown(lines: tuple[str, ...]) -> str:
    more = len(lines) - NAMED
    return "; ".join(lines[:NAMED]) + (f" and {more} more" if more > 0 else "")
