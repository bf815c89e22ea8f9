"""Instructions of operators about accepted runs: list, abort, cancel, change the priority."""

import asyncio
import logging
from collections.abc import Callable

from swarmd.mission.core.run import Action
from swarmd.mission.core.scheduler import MissionScheduler
from swarmd.mission.dispatcher import ABORT_PATH, PRIORITY_PATH, Dispatcher
from swarmware.errors import Conflict, InvalidInput, NotFound
from swarmware.mission.model import PRIORITIES
from swarmware.module.inbox import Inbox
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.types.mission import (
    INACTIVE,
    AbortAnswer,
    MissionAbort,
    MissionQueue,
    MissionState,
    PriorityChange,
)
from swarmware.types.rpc import Empty

log = logging.getLogger("swarm.mission")


class RunControl:
    """Passes instructions about runs on to the members, and carries out received instructions."""

    def __init__(
        self,
        module: Module,
        core: MissionScheduler,
        dispatcher: Dispatcher,
        states: Callable[[], dict[str, MissionState]],
        feed: Callable[[list[Action]], None],
        check: Callable[[str], None],
    ) -> None:
        """`states`: returns the mission states of this platform and of all present platforms.

        `check`: raises Conflict for a built-in mission that a reaction forbids.
        """
        self._module = module
        self._core = core
        self._dispatcher = dispatcher
        self._states = states
        self._feed = feed
        self._check = check
        self._aborts: Inbox[MissionAbort] = module.inbox(ABORT_PATH, MissionAbort)
        self._priorities: Inbox[PriorityChange] = module.inbox(PRIORITY_PATH, PriorityChange)
        module.serve(
            "sys/mission/abort",
            MissionAbort,
            self._on_abort,
            reply=AbortAnswer,
            description="Stop the mission at all its members",
        )
        module.serve(
            "sys/mission/prioritize",
            PriorityChange,
            self._on_priority,
            reply=AbortAnswer,
            description="Change the priority of a run at all its members",
        )
        module.serve(
            "sys/mission/queue",
            Empty,
            self._on_queue,
            reply=MissionQueue,
            description="Runs that are played, wait or are suspended",
        )

    async def run(self) -> None:
        """Carry out received instructions until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._take_aborts(), name="mission:aborts")
            group.create_task(self._take_priorities(), name="mission:priorities")

    def _on_queue(self, request: Empty, meta: Meta) -> MissionQueue:
        return MissionQueue(self._module.platform, tuple(self._core.queue()))

    async def _on_abort(self, order: MissionAbort, meta: Meta) -> AbortAnswer:
        if order.epoch:
            ordered = self._members(order.epoch)
        else:
            states = self._states()
            ordered = tuple(name for name, one in states.items() if one.state not in INACTIVE or one.kept)
            if self._core.phase not in INACTIVE:
                ordered = tuple(member.platform for member in self._core.members)
            # as far as known here nothing runs; a state may be lost, so all platforms are instructed
            ordered = ordered or tuple(states)
        silent = await self._dispatcher.send_all(ABORT_PATH, ordered, order, meta.sender)
        return AbortAnswer(tuple(name for name in ordered if name not in silent), silent)

    async def _on_priority(self, change: PriorityChange, meta: Meta) -> AbortAnswer:
        low, high = PRIORITIES
        if not low <= change.priority <= high:
            raise InvalidInput(f"priority {change.priority}: expected a number from {low} to {high}")
        ordered = self._members(change.epoch)
        silent = await self._dispatcher.send_all(PRIORITY_PATH, ordered, change, meta.sender)
        return AbortAnswer(tuple(name for name in ordered if name not in silent), silent)

    def _members(self, epoch: int) -> tuple[str, ...]:
        """Platforms that play or keep a run. Raises: NotFound."""
        states = self._states()
        found = tuple(
            name
            for name, one in states.items()
            if epoch in one.kept or (one.epoch == epoch and one.state not in INACTIVE)
        )
        # members of a run that was just ordered have not reported it yet
        found = self._dispatcher.just_ordered(epoch) or found
        if not found:
            known = sorted({epoch for one in states.values() for epoch in (*one.kept, one.epoch) if epoch})
            raise NotFound(
                f"run {epoch}: neither played nor kept by a platform in reach; known:"
                f" {', '.join(map(str, known)) or 'none'}"
            )
        return found

    async def _take_aborts(self) -> None:
        async for order in self._aborts:
            if order.epoch and not self._core.keeps(order.epoch):
                continue  # the run has ended here: nothing may stop in its place
            log.warning("abort: %s", order.reason)
            try:
                if order.then:
                    self._check(order.then)
                core, now_ns = self._core, self._module.now_ns()
                if order.epoch:
                    self._feed(core.on_cancel(order.epoch, order.reason, order.then, now_ns))
                else:
                    self._feed(core.on_abort(order.reason, order.then, now_ns))
            except Conflict as error:
                log.warning("abort refused: %s", error)

    async def _take_priorities(self) -> None:
        async for change in self._priorities:
            log.info("run %d: priority %d", change.epoch, change.priority)
            self._feed(self._core.on_priority(change.epoch, change.priority, self._module.now_ns()))
