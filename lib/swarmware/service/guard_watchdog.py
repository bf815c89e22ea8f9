"""Watchdog of the guard: every process of a node restarts a guard that has died (S1.26)."""

import asyncio
import logging
from contextlib import suppress
from typing import Final

from swarmware.errors import NotFound, SwarmError
from swarmware.node.node import Node
from swarmware.runtime.backoff import PAUSES_S, RestartPolicy
from swarmware.runtime.processes import process_end
from swarmware.service.exit_status import ExitStatus
from swarmware.service.starting import GUARD, clear_start_record, spawn_missing
from swarmware.service.supervised_process import SupervisedProcess
from swarmware.transport.appfile.entry import AppEntry
from swarmware.transport.appfile.trace import died, last_of

LOOK_S: Final = 0.5
"""Period of looking for a missing guard: a process that was starting it may have been killed."""

log = logging.getLogger("swarm.guardwatch")


class GuardWatchdog:
    """Waits for the end of the guard; one of the waiting processes restarts it."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._changed = asyncio.Event()
        self._restart_policy = RestartPolicy()
        self._process: SupervisedProcess | None = None

    async def run(self) -> None:
        """Watch the guard until cancelled."""
        changes = self._node.applications.subscribe(lambda _: self._changed.set())
        try:
            await self._keep()
        finally:
            changes.close()
            if self._process is not None:
                self._process.close()

    async def _keep(self) -> None:
        node, missed = self._node, False
        while True:
            guard = self._find()
            if guard is not None and guard.lives:
                self._restart_policy.on_ready(node.clock.now_ns())
                clear_start_record(GUARD, node.run_dir)
                try:
                    await process_end(guard.pid)
                except OSError:
                    await asyncio.sleep(LOOK_S)  # it has ended already, or no descriptor is free
                missed = _alone(guard) and died(node.run_dir, guard)
                if missed:
                    await self._pause()
                continue
            if missed or self._died_before():
                missed = True
                self._start()
            # the file of a dead guard can be locked by another process for a moment, which reports no change
            await self._wait(LOOK_S if missed or guard is not None else None)

    def _find(self) -> AppEntry | None:
        table = self._node.table
        table.refresh(probe=True)
        return table.named(GUARD)

    def _died_before(self) -> bool:
        """Whether a guard died before this process started."""
        before = last_of(self._node.run_dir, GUARD)
        return before is not None and _alone(before)

    async def _pause(self) -> None:
        pause_s = self._restart_policy.on_end(self._node.clock.now_ns(), killed=False)
        await asyncio.sleep(PAUSES_S[-1] if pause_s is None else pause_s)  # the guard is never given up

    async def _wait(self, timeout_s: float | None) -> None:
        self._changed.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):  # wait_for of Python 3.11 can lose a cancellation
                await self._changed.wait()

    def _start(self) -> None:
        try:
            started = spawn_missing(GUARD, self._node.config_dir, self._node.run_dir)
        except OSError as error:
            log.error("guard: cannot be started: %s", error)
            return
        if started is not None:
            log.warning("guard: died; started again, pid %d", started.pid)
            if self._process is not None:
                self._process.close()
            with suppress(NotFound, SwarmError):
                self._process = SupervisedProcess(started, self._ended)

    def _ended(self, how: ExitStatus) -> None:
        self._process = None
        log.warning("guard: ended: %s", how)
        self._changed.set()


def _alone(guard: AppEntry) -> bool:
    """Whether systemd does not restart it."""
    return bool(guard.config.get("supervisor", "self") == "self")
