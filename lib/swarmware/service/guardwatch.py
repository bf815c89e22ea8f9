"""Every process of a node of several processes starts the guard again when it died: the one thing that the
guard cannot do itself (S1.26)."""

import asyncio
import logging
from contextlib import suppress
from typing import Final

from swarmware.appfile import AppEntry, AppTable
from swarmware.appfile.trace import died, last_of
from swarmware.errors import NotFound, SwarmError
from swarmware.node import Node
from swarmware.node.node import APPS_TABLE
from swarmware.runtime.processes import process_end
from swarmware.service.child import Child
from swarmware.service.lives import PAUSES_S, Lives
from swarmware.service.starting import GUARD, clear_start_record, spawn_missing

LOOK_S: Final = 0.5
"""How often a guard that is missed is looked for: another process may have started it, and been killed."""
SETTLED_S: Final = 1.0
"""A guard that ran for so long is started again without a pause."""

log = logging.getLogger("swarm.guardwatch")


class GuardWatch:
    """Waits for the death of the guard; of all processes that do, one starts it again."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._table = AppTable(node.run_dir)
        self._changed = asyncio.Event()
        self._lives = Lives(settled_s=SETTLED_S)
        self._child: Child | None = None

    def poll(self) -> None:
        """The doorbell has rung: perhaps there is a guard."""
        self._changed.set()

    async def run(self) -> None:
        """Watches until cancelled."""
        node = self._node
        node.listen(node.shm_dir / APPS_TABLE)
        node.watch(self)
        try:
            await self._keep()
        finally:
            node.unwatch(self)
            node.unlisten(node.shm_dir / APPS_TABLE)
            if self._child is not None:
                self._child.close()

    async def _keep(self) -> None:
        node, missed = self._node, False
        while True:
            guard = self._find()
            if guard is not None:
                self._lives.on_ready(node.clock.now_ns())
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
            await self._wait(LOOK_S if missed else None)

    def _find(self) -> AppEntry | None:
        self._table.refresh(probe=True)
        return self._table.named(GUARD)

    def _died_before(self) -> bool:
        """Whether a guard died before this process could see it."""
        before = last_of(self._node.run_dir, GUARD)
        return before is not None and _alone(before)

    async def _pause(self) -> None:
        pause_s = self._lives.on_end(self._node.clock.now_ns(), killed=False)
        await asyncio.sleep(PAUSES_S[-1] if pause_s is None else pause_s)  # never given up: it is the guard

    async def _wait(self, timeout_s: float | None) -> None:
        self._changed.clear()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), timeout_s)

    def _start(self) -> None:
        try:
            started = spawn_missing(GUARD, self._node.config_dir, self._node.run_dir)
        except OSError as error:
            log.error("guard: cannot be started: %s", error)
            return
        if started is not None:
            log.warning("guard: died; started again, pid %d", started.pid)
            if self._child is not None:
                self._child.close()
            with suppress(NotFound, SwarmError):
                self._child = Child(started, self._ended)

    def _ended(self, how: str) -> None:
        self._child = None
        log.warning("guard: ended: %s", how)
        self._changed.set()


def _alone(guard: AppEntry) -> bool:
    """Whether no systemd starts it again."""
    return bool(guard.config.get("supervisor", "self") == "self")
