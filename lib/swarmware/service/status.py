"""A service's own report, once a second: its beat, its process's load, the lateness of its event loop."""

from __future__ import annotations

import asyncio
import logging
import os
import time
from typing import TYPE_CHECKING, Final

from swarmware.names import segment
from swarmware.types.system import AppStatus

if TYPE_CHECKING:
    from swarmware.module import BoardWriter, Module

PERIOD_S: Final = 1.0
SLOW_S: Final = 0.05
"""An event loop later than this makes every service of the process late: an operator should know."""
SLOW_EVERY_S: Final = 30.0
"""Not more often than this is it said."""

_PAGE_BYTES: Final = os.sysconf("SC_PAGE_SIZE")
_MB: Final = 1_000_000

log = logging.getLogger("swarm.status")


class Reporter:
    """Writes the board `app/<name>/status`; a hyphen of the name is an underscore there."""

    def __init__(self, module: Module, writer: BoardWriter[AppStatus], restarts: int) -> None:
        self.state = "starting"
        self._module = module
        self._writer = writer
        self._restarts = restarts
        self._beat = 0
        self._cpu_s = time.process_time()
        self._at_s = time.monotonic()
        self._warned_s = -SLOW_EVERY_S

    @classmethod
    async def open(cls, module: Module, restarts: int) -> Reporter:
        """Makes the board and writes the first report."""
        writer = await module.writer(
            f"app/{segment(module.name)}/status",
            AppStatus,
            rate_hz=1 / PERIOD_S,
            description="Beat of the application",
        )
        made = cls(module, writer, restarts)
        made.report(0.0)
        return made

    async def beat_while(self, task: asyncio.Task[None]) -> None:
        """Reports every second until the task is done."""
        due_s = time.monotonic() + PERIOD_S
        while not task.done():
            wait_s = due_s - time.monotonic()
            await asyncio.wait([task], timeout=max(wait_s, 0.0))
            if task.done():
                return
            late_s = max(time.monotonic() - due_s, 0.0)
            due_s += PERIOD_S if late_s < PERIOD_S else late_s
            self.report(max(late_s, self._module.lateness.take_s()))

    def report(self, late_s: float) -> None:
        """Writes one report."""
        now_s, cpu_s = time.monotonic(), time.process_time()
        span_s = max(now_s - self._at_s, 1e-3)
        self._beat += 1
        self._writer.write(
            AppStatus(
                os.getpid(),
                self.state,
                self._beat,
                self._restarts,
                round((cpu_s - self._cpu_s) / span_s * 100, 2),
                round(_resident_bytes() / _MB, 1),
                round(late_s * 1000, 1),
            )
        )
        self._cpu_s, self._at_s = cpu_s, now_s
        if late_s > SLOW_S and now_s - self._warned_s > SLOW_EVERY_S:
            self._warned_s = now_s
            log.warning("%s: the event loop was late by %.0f ms", self._module.name, late_s * 1000)


def _resident_bytes() -> int:
    with open("/proc/self/statm", "rb") as file:  # noqa: PTH123  # read every second: no Path object
        return int(file.read().split()[1]) * _PAGE_BYTES
