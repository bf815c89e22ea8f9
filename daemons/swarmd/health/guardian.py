"""The other half of the mutual watch: the monitor starts the guard again (S1.26)."""

import asyncio
import logging
import os
import signal
from contextlib import suppress
from typing import Final

from swarmware.appfile import AppEntry
from swarmware.errors import NotFound
from swarmware.node import Node
from swarmware.service.child import Child, newborn, settled, spawn
from swarmware.types.health import GuardStatus

NAME: Final = "guard"
PAUSES_S: Final = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Before the first, second, … start in a row."""
SETTLED_S: Final = 10.0

log = logging.getLogger("swarm.health")


class Guardian:
    """Starts the guard when it died, kills it when it hangs; only a guard that supervises by itself."""

    def __init__(self, node: Node, *, enabled: bool) -> None:
        self._node = node
        self._enabled = enabled and node.config.processes == "per-daemon"
        self._loop = asyncio.get_running_loop()
        self._seen = False
        self._pid = 0
        self._child: Child | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._in_a_row = 0
        self._since_s = 0.0

    def on_present(self, entry: AppEntry) -> None:
        """There is a guard."""
        self._seen = entry.config.get("supervisor", "self") == "self"
        if entry.pid != self._pid:
            self._pid = entry.pid
            self._since_s = self._loop.time()
            settled(NAME, self._node.run_dir)
        self._cancel()

    def on_missing(self, before: GuardStatus) -> None:
        """There is none, but one has left its board without goodbye: it died before we looked."""
        self._seen = before.supervisor == "self"
        self.on_died()

    def on_left(self) -> None:
        """It said goodbye: it is not missed."""
        self._seen = False
        self._cancel()

    def on_died(self) -> None:
        """It ended without goodbye."""
        if not (self._enabled and self._seen) or self._timer is not None:
            return
        settled_long = self._loop.time() - self._since_s >= SETTLED_S
        self._in_a_row = 1 if settled_long else self._in_a_row + 1
        pause_s = PAUSES_S[min(self._in_a_row, len(PAUSES_S)) - 1]
        self._timer = self._loop.call_later(pause_s, self._start)

    def on_hung(self, pid: int) -> None:
        """It does not beat: only SIGKILL ends a process that is stopped."""
        if self._enabled and self._seen:
            log.warning("guard: no beat, pid %d is killed", pid)
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def _start(self) -> None:
        self._timer = None
        if newborn(NAME, self._node.run_dir):
            return
        if self._child is not None:
            self._child.close()
        pid = spawn(NAME, self._node.config_dir, self._node.run_dir)
        log.warning("guard: died; started again, pid %d", pid)
        self._since_s = self._loop.time()
        with suppress(NotFound):
            self._child = Child(pid, self._ended)

    def _ended(self, how: str) -> None:
        """The one that we started: when it never joined nobody else tells of its end."""
        self._child = None
        log.warning("guard: ended: %s", how)
        settled(NAME, self._node.run_dir)
        self.on_died()

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def close(self) -> None:
        """Watch no more."""
        self._cancel()
        if self._child is not None:
            self._child.close()
            self._child = None
