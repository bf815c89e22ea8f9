"""Runs functional blocks: one task each, which ends or is cancelled."""

import asyncio
import logging
from collections.abc import Callable
from functools import partial

from swarmd.mission.blocks.context import Context
from swarmd.mission.blocks.plugins import Plugins
from swarmd.mission.core.run import StartBlock
from swarmd.mission.questions import Questions
from swarmd.mission.vehicle import VehicleClient
from swarmware.mission.outcome import CANCELLED, CRASHED, SUCCESS, BlockOutcome, OutcomeKind
from swarmware.mission.plugin import BlockError
from swarmware.module.module import Module

log = logging.getLogger("swarm.mission")

Ended = Callable[[int, BlockOutcome, str], None]
"""Called at the end of a block with its token, result and text."""
Report = Callable[[int, float, str], None]


class BlockRunner:
    """The running blocks, by token."""

    def __init__(
        self, module: Module, vehicle: VehicleClient | None, plugins: Plugins, ended: Ended, report: Report
    ) -> None:
        self._module = module
        self._vehicle = vehicle
        self._plugins = plugins
        self._ended = ended
        self._report = report
        self._questions = Questions(module)
        self._tasks: dict[int, asyncio.Task[None]] = {}

    def start(self, action: StartBlock) -> None:
        """Start the task of a block."""
        block = action.block
        context = Context(
            self._module,
            self._vehicle,
            block.id,
            block.params,
            partial(self._report, action.token),
            self._questions,
        )
        work = self._plugins.make(block.type)
        task = asyncio.get_running_loop().create_task(work.run(context), name=f"block:{block.id}")
        self._tasks[action.token] = task
        task.add_done_callback(partial(self._done, action.token))

    def cancel(self, token: int) -> None:
        """Cancels a block, unless it is ending already."""
        task = self._tasks.get(token)
        if task is not None:
            task.cancel()

    async def close(self) -> None:
        """Cancels all blocks and waits for their ends."""
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks, timeout=2.0)

    def _done(self, token: int, task: asyncio.Task[None]) -> None:
        self._tasks.pop(token, None)
        if task.cancelled():
            self._ended(token, CANCELLED, "")
            return
        error = task.exception()
        if error is None:
            self._ended(token, SUCCESS, "")
        elif isinstance(error, BlockError):
            self._ended(token, BlockOutcome(OutcomeKind.ERROR, error.kind), str(error))
        else:
            # after any exception of a block the mission continues at its error successor or ends safely
            log.error("block %s failed", task.get_name(), exc_info=error)
            self._ended(token, CRASHED, f"{type(error).__name__}: {error}")
