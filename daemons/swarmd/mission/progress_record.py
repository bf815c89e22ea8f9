"""The record of a mission's steps, as events and in the log: written at shared instants of the node."""

import asyncio
import logging
from collections.abc import Callable
from typing import Final, Protocol

from swarmware.runtime.core import HardwareClock
from swarmware.runtime.instant import wait_s
from swarmware.types.mission import MissionProgress

PERIOD_NS: Final = 50_000_000
"""The node is awake at multiples of it (ADR 28). No process waits for a record, unlike for an order or the
end of a block all members of a mission wait, and on a busy computer also for the processor time of the
others."""

log = logging.getLogger("swarm.mission")


class ProgressWriter(Protocol):
    """Publishes steps as events."""

    def write(self, value: MissionProgress, stamp_ns: int | None = None) -> int:
        """Publishes a step with the stamp given."""
        ...


class ProgressRecord:
    """Collects steps, and writes them in their order with their own stamps."""

    def __init__(
        self, writer: ProgressWriter, clock: HardwareClock, keep: Callable[[list[MissionProgress]], None]
    ) -> None:
        """`keep`: takes the steps that were written, for the folder of their run."""
        self._writer = writer
        self._keep = keep
        self._clock = clock
        self._steps: list[MissionProgress] = []
        self._timer: asyncio.TimerHandle | None = None

    def add(self, step: MissionProgress) -> None:
        """Adds a step; it is written within `PERIOD_NS`."""
        self._steps.append(step)
        if self._timer is None:
            due_ns = (self._clock.now_ns() // PERIOD_NS + 1) * PERIOD_NS
            self._timer = asyncio.get_running_loop().call_later(wait_s(self._clock, due_ns), self._write)

    def _write(self) -> None:
        self._timer = None
        steps, self._steps = self._steps, []
        for step in steps:
            self._writer.write(step, step.at_ns)
            level = logging.DEBUG if step.block else logging.INFO
            log.log(level, "%s %s: %s %s", step.mission, step.block or "mission", step.event, step.text)
        self._keep(steps)

    def close(self) -> None:
        """Writes what is left."""
        if self._timer is not None:
            self._timer.cancel()
            self._write()
