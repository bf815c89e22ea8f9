"""The services of one process: each kept running, none disturbed by the end of another."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING, Final

import msgspec

from swarmware.errors import NotFound, SwarmError
from swarmware.module import Module
from swarmware.service.reason import reason
from swarmware.service.status import Reporter, beat

if TYPE_CHECKING:
    from swarmware.node import Node
    from swarmware.service.service import Service

BACKOFF_S: Final = (0.0, 0.1, 0.5, 1.0, 2.0, 5.0)
"""Pause before the n-th start in a row; the last one from then on."""
SETTLED_S: Final = 10.0
"""A service that ran so long starts again without a pause."""

log = logging.getLogger("swarm.host")


class Prepared(msgspec.Struct, frozen=True):
    """A service that is ready to be started: its class was found and its configuration is valid."""

    cls: type[Service]
    config: msgspec.Struct

    @property
    def name(self) -> str:
        """Name of the service."""
        return self.cls.name


class Ended(SwarmError):
    """A service came to an end although nobody asked it to."""


class Host:
    """Runs services in this process.

    With several of them, one that fails is started again here; one that is alone ends the process,
    because whoever supervises the process then does it better.
    """

    def __init__(self, node: Node, prepared: list[Prepared]) -> None:
        self.node = node
        self._prepared = {item.name: item for item in prepared}
        self._running: dict[str, Service] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._again: set[str] = set()
        self._started: dict[str, asyncio.Event] = {name: asyncio.Event() for name in self._prepared}
        self._reporters: dict[str, Reporter] = {}

    @property
    def names(self) -> list[str]:
        """Names of the services, in the order of their start."""
        return list(self._prepared)

    @property
    def stop_s(self) -> float:
        """Time that the slowest of them may take to stop."""
        return max((item.cls.stop_s for item in self._prepared.values()), default=0.0)

    async def started(self) -> None:
        """Returns when every service has run up to its first wait."""
        for event in self._started.values():
            await event.wait()

    async def run(self) -> None:
        """Runs until cancelled. Raises: Ended or what the only service raised."""
        async with asyncio.TaskGroup() as group:
            for item in self._prepared.values():
                group.create_task(self._keep(item), name=f"keep:{item.name}")
            group.create_task(beat(self.node.clock, lambda: tuple(self._reporters.values())), name="beat")

    def restart(self, name: str) -> None:
        """Cancels a service that hangs or is to be started again; it starts again at once.

        Raises: NotFound when no such service runs in this process.
        """
        task = self._tasks.get(name)
        if task is None:
            raise NotFound(f"service {name!r}: not in this process; expected one of {', '.join(self._tasks)}")
        self._again.add(name)
        task.cancel()

    async def stop(self) -> None:
        """Asks every service to finish, last started first."""
        for name in reversed(self.names):
            service = self._running.get(name)
            if service is None:
                continue
            service.module.keep_boards(False)
            if reporter := self._reporters.get(name):
                reporter.state = "stopping"
                reporter.report()  # its end is a goodbye, not a death
            try:
                await asyncio.wait_for(service.stop(), service.stop_s)
            except TimeoutError:
                log.warning("%s: did not finish within %s s", name, service.stop_s)
            except Exception:
                log.exception("%s: failed while stopping", name)

    async def _keep(self, item: Prepared) -> None:
        alone = len(self._prepared) == 1
        failures = 0
        restarts = 0
        said: str | None = None
        while True:
            began_s = time.monotonic()
            try:
                await self._run_once(item, restarts)
            except Exception as error:
                if alone:
                    raise
                self._started[item.name].set()  # it has had its chance; the others do not wait for it
                text = reason(error)
                if text is None:
                    log.error("%s: failed: %s", item.name, error, exc_info=error)
                elif text != said:  # once: it will be the same at each start until somebody mends it
                    log.error("%s: failed: %s", item.name, text)
                said = text
            settled = time.monotonic() - began_s >= SETTLED_S
            failures = 1 if settled else failures + 1
            restarts += 1
            pause_s = BACKOFF_S[min(failures - 1, len(BACKOFF_S) - 1)]
            level = logging.WARNING if failures <= len(BACKOFF_S) or said is None else logging.DEBUG
            log.log(level, "%s: starts again in %s s (restart %d)", item.name, pause_s, restarts)
            await asyncio.sleep(pause_s)

    async def _run_once(self, item: Prepared, restarts: int) -> None:
        async with Module(item.name, node=self.node, config=item.config) as module:
            service = item.cls(module, item.config)
            reporter = self._reporters[item.name] = await Reporter.open(module, restarts)
            self._running[item.name] = service
            task = asyncio.create_task(service.run(), name=f"run:{item.name}")
            self._tasks[item.name] = task
            module.keep_boards()  # readable while the service comes back; `stop` undoes this
            try:
                await asyncio.sleep(0)
                if task.done():
                    await task  # it cannot even begin: nobody is told that it runs
                reporter.state = "running"
                reporter.report()  # whoever waits for it does not wait for the next beat
                self._started[item.name].set()
                await asyncio.wait([task])
                if not (task.cancelled() and item.name in self._again):
                    await task
                    raise Ended(
                        f"service {item.name}: run() returned; expected it to run until it is cancelled"
                    )
            finally:
                self._again.discard(item.name)
                self._reporters.pop(item.name, None)
                await _ended(task)
                self._running.pop(item.name, None)


async def _ended(task: asyncio.Task[None]) -> None:
    """Cancels the task and waits for its end; what it says then was logged or is of no interest."""
    if not task.done():
        task.cancel()
    await asyncio.wait([task])
