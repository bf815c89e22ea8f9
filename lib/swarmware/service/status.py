"""Status board of each service, once a second: heartbeat, load of the process, lateness of the event loop."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

import msgspec

from swarmware.errors import SwarmError
from swarmware.model import paths
from swarmware.model.clock import Clock
from swarmware.module.module import Module
from swarmware.module.ticker import Lateness, Ticker
from swarmware.module.writer import BoardWriter
from swarmware.types.system import AppState, AppStatus

PERIOD_S: Final = 1.0
SLOW_S: Final = 0.05
"""Lateness of the event loop that is logged as a warning: it delays every service of the process."""
SLOW_EVERY_S: Final = 30.0
"""Minimum time between two such warnings."""

_PAGE_BYTES: Final = os.sysconf("SC_PAGE_SIZE")
_MB: Final = 1_000_000

log = logging.getLogger("swarm.status")


class Load(NamedTuple):
    """Resources that this process has used up to an instant."""

    at_s: float
    cpu_s: float
    resident_bytes: int
    """Memory, or 0 if the process has no free descriptor to read it."""

    @classmethod
    def measured(cls) -> Load:
        """The present processor time and memory of this process."""
        try:
            with open("/proc/self/statm", "rb") as file:  # noqa: PTH123  # read every second: no Path object
                resident_bytes = int(file.read().split()[1]) * _PAGE_BYTES
        except OSError:  # no free descriptor: a heartbeat without this figure keeps the service alive
            resident_bytes = 0
        return cls(time.monotonic(), time.process_time(), resident_bytes)


class Reporter:
    """Writes the board `app/<name>/status`; a hyphen of the name is an underscore there."""

    def __init__(self, module: Module, writer: BoardWriter[AppStatus], restarts: int, failures: int) -> None:
        self.state = AppState.STARTING
        self._module = module
        self._writer = writer
        self._restarts = restarts
        self._failures = failures
        self._beat = 0
        self._before = Load.measured()

    @classmethod
    def open(cls, module: Module, restarts: int = 0, failures: int = 0) -> Reporter:
        """Open the board and write the first report."""
        writer = module.writer(
            paths.status(module.name),
            AppStatus,
            rate_hz=1 / PERIOD_S,
            description="Heartbeat of the application",
        )
        made = cls(module, writer, restarts, failures)
        made.report()
        return made

    def beat(self, late_s: float, load: Load) -> float:
        """Write the report of one second that ended `late_s` late; the largest lateness in it."""
        late_s = max(late_s, self._module.lateness.take_s())
        self.report(late_s, load)
        return late_s

    def report(self, late_s: float = 0.0, load: Load | None = None) -> None:
        """Write one report; `load`: measured just before."""
        now = Load.measured() if load is None else load
        span_s = max(now.at_s - self._before.at_s, 1e-3)
        self._beat += 1
        counters = self._module.node.messaging.counters()
        self._writer.write(
            AppStatus(
                os.getpid(),
                self.state,
                self._beat,
                self._restarts,
                round((now.cpu_s - self._before.cpu_s) / span_s * 100, 2),
                round(now.resident_bytes / _MB, 1),
                round(late_s * 1000, 1),
                messages=counters if any(msgspec.structs.astuple(counters)) else None,
                failures=self._failures,
            )
        )
        self._before = now


async def beat(clock: Clock, reporters: Callable[[], Iterable[Reporter]]) -> None:
    """Write the heartbeats of all services of a process every second: they share its event loop."""
    lateness = Lateness()
    warned_s = -SLOW_EVERY_S
    logged = ""
    async for _ in Ticker(clock, PERIOD_S, lateness):
        load, late_s = Load.measured(), lateness.take_s()
        worst_s = late_s
        for reporter in reporters():
            try:
                worst_s = max(worst_s, reporter.beat(late_s, load))
            except (SwarmError, OSError) as error:
                if str(error) != logged:  # once: the guard detects missing heartbeats
                    logged = str(error)
                    log.error("heartbeat cannot be written: %s", logged)
        if worst_s > SLOW_S and load.at_s - warned_s > SLOW_EVERY_S:
            warned_s = load.at_s
            log.warning("the event loop was late by %.0f ms", worst_s * 1000)
