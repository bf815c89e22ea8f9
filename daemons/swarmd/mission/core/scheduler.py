"""The mission manager: which run of a platform is played now, which ones wait, and which ones are suspended.

Each run has an executor, whose phases are the table `run.TRANSITIONS`. At most one of them plays: the others
are in the queue, where they have not begun or are suspended. After each event the manager compares the run
that is played with the first one of the queue:

    played            first of the queue        the manager
    ---------------   -----------------------   ------------------------------------------------
    nothing, ended    any                       calls it: it begins, or continues
    ready             an earlier rank           puts the played one back, unless its start is fixed; calls
    running           a higher priority         suspends the played one; calls when it has stopped
    recovering        any                       waits: a built-in mission precedes all others

A reaction may suspend the played run as well, which continues when the reaction and its built-in mission
have ended.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Final

import msgspec

from swarmd.mission.config import Config
from swarmd.mission.core.announcement import Announcer
from swarmd.mission.core.commons import Commons
from swarmd.mission.core.executor import MissionExecutor
from swarmd.mission.core.run import MAKING_WAY, Action, Announce, ProgressStep, Run
from swarmd.mission.core.run_queue import QueuedRun, RunQueue
from swarmware.errors import Conflict, SwarmError
from swarmware.mission.condition import Lookup
from swarmware.mission.model import MissionDefinition
from swarmware.mission.outcome import BlockOutcome
from swarmware.mission.reaction import ReactionRow
from swarmware.runtime.core import AT_ONCE
from swarmware.types.control import ControlState
from swarmware.types.mission import (
    INACTIVE,
    BarrierResult,
    Member,
    MissionPhase,
    MissionState,
    QueuedMission,
)

BUSY: Final = frozenset({MissionPhase.READY, MissionPhase.RUNNING, *MAKING_WAY})
"""Phases of a played mission that another one may follow or suspend."""


class MissionScheduler:
    """Decides about the missions of this platform; the shell runs blocks, writes boards, receives states."""

    def __init__(
        self,
        platform: str,
        built_in: Mapping[str, MissionDefinition],
        lookup: Lookup,
        chance: Callable[[], float],
        config: Config,
        lead: Callable[[frozenset[str]], int],
    ) -> None:
        """`lead`: returns the nanoseconds that the result of a barrier needs to reach these platforms."""
        self._platform = platform
        self._built_in = frozenset(built_in)
        self._commons = Commons()
        self._make: Callable[[], MissionExecutor] = partial(
            MissionExecutor, platform, built_in, lookup, chance, config, lead, self._commons
        )
        self._announcer = Announcer()
        self._queue = RunQueue()
        self._played: QueuedRun | None = None
        """The run of the executor, or None if it plays a built-in mission or nothing."""
        self._executor = self._make()
        self._interruption: tuple[str, str, str] | None = None
        """Row, reason and built-in mission of the reaction for which the played run is being suspended."""
        self._blocked_by = ""
        """Row of the active reaction after which the suspended run continues, or "" without one."""
        self.orders = 0
        """Number of orders that were accepted: missions, manoeuvres and aborts."""

    # -- what the shell asks

    @property
    def phase(self) -> MissionPhase:
        """The phase of the run that is played."""
        return self._executor.phase

    @property
    def since_ns(self) -> int:
        """When the present phase began."""
        return self._executor.since_ns

    @property
    def role(self) -> str:
        """The role of this platform in the mission that is played."""
        return self._executor.role

    @property
    def members(self) -> tuple[Member, ...]:
        """Members of the ensemble of the present or last run."""
        return self._executor.members

    @property
    def epoch(self) -> int:
        """Epoch of the present or last run; 0 without one."""
        return self._executor.epoch

    @property
    def unmet(self) -> tuple[str, ...]:
        """Requirements that did not hold at the last evaluation."""
        return self._executor.unmet

    @property
    def rows(self) -> tuple[ReactionRow, ...]:
        """Reactions of the running mission, which precede the reactions of the platform."""
        return self._executor.rows

    @property
    def on_link_loss(self) -> str:
        """Policy of the running mission for a lost link, or "" for the policy of the platform."""
        return self._executor.on_link_loss

    @property
    def ordered_by(self) -> str:
        """Sender of the order of the present or last run, or "" if unknown."""
        return "" if self._played is None else self._played.run.by

    @property
    def is_idle(self) -> bool:
        """Whether nothing is played and nothing waits."""
        return self.phase in INACTIVE and not len(self._queue)

    def keeps(self, epoch: int) -> bool:
        """Whether this run was accepted, and has not ended."""
        played = self._executor.epoch == epoch and self.phase not in INACTIVE
        return played or self._queue.find(epoch) is not None

    def state(self) -> MissionState:
        """The state that the platform publishes on its board."""
        state = self._executor.state()
        return msgspec.structs.replace(state, kept=self._queue.epochs) if len(self._queue) else state

    def queue(self) -> list[QueuedMission]:
        """The run that is played, then the others in their order."""
        played = self._played
        rows = [] if played is None or self.phase in INACTIVE else [played.entry("")]
        return rows + [one.entry(self._why(one)) for one in self._queue]

    def waits(self, epoch: int) -> str:
        """Why a run waits, or "" if it does not."""
        one = self._queue.find(epoch)
        return "" if one is None else self._why(one)

    def _why(self, one: QueuedRun) -> str:
        reason = one.executor.makes_way_for
        if reason and not self._hindrance():
            return reason
        if hindrance := self._hindrance():
            return hindrance
        before = next((other for other in self._queue if other.rank < one.rank), None)
        played = self._played if self.phase not in INACTIVE else None
        first = played or before
        if first is None:
            return ""
        return f"after {first.run.name} ({first.run.epoch}), priority {first.priority}"

    def _hindrance(self) -> str:
        """Reason why no run may begin or continue now, whatever its priority, or "" if a run may."""
        if self._commons.held_by:
            return f"{self._platform} is driven by hand by {self._commons.held_by}"
        if self._blocked_by:
            return f"reaction {self._blocked_by} is active"
        if self.phase not in INACTIVE | BUSY:
            return f"{self._platform} is busy: {self._executor.playing} is {self.phase}"
        return ""

    # -- orders

    def on_order(self, run: Run, now_ns: int) -> list[Action]:
        """Accepts a run, which begins when its turn has come and all members have accepted it.

        Raises: Conflict when the platform cannot play it: driven by hand, a built-in mission runs, a
        requirement is not met, the queue is full.
        """
        # a mission that is ending hinders only the call of the run, not its place in the queue
        if self.phase is not MissionPhase.ENDING and (hindrance := self._hindrance()):
            raise Conflict(hindrance)
        executor = self._make()
        executor.check(run)
        self._queue.check_room()
        self.orders += 1
        self._queue.put(QueuedRun(run, executor, run.priority, now_ns))
        return self._settle([], now_ns)

    def on_priority(self, epoch: int, priority: int, now_ns: int) -> list[Action]:
        """Changes the priority of a run, which may then suspend another one or be suspended."""
        played = self._played
        one = played if played is not None and played.run.epoch == epoch else self._queue.find(epoch)
        if one is None:
            return []
        steps: list[Action] = [_step(one, "priority", f"{one.priority} → {priority}")]
        one.priority = priority
        return self._settle(steps, now_ns)

    def on_abort(self, reason: str, then: str, now_ns: int) -> list[Action]:
        """Stops all runs, then plays the built-in mission `then`, or the `on_failure` of the played run.

        Raises: Conflict when this platform has no such built-in mission.
        """
        actions = self._executor.on_abort(reason, then, now_ns)
        self.orders += 1
        return self._settle(actions + self._discard_all(reason, now_ns), now_ns)

    def on_cancel(self, epoch: int, reason: str, then: str, now_ns: int) -> list[Action]:
        """Stops one run; the others remain.

        Raises: as `on_abort`.
        """
        if self._queue.find(epoch) is not None:  # not an order to the vehicle: reactions stay in force
            return self._settle(self._discard(epoch, reason, now_ns), now_ns)
        if epoch != self.epoch:
            return []
        self.orders += 1
        return self._settle(self._executor.on_abort(reason, then, now_ns), now_ns)

    def on_manoeuvre(self, name: str, mission: MissionDefinition, reason: str, now_ns: int) -> list[Action]:
        """Stops all missions, then plays a manoeuvre that an operator orders."""
        self.orders += 1
        discarded = self._discard_all(reason, now_ns)
        return self._settle(discarded + self._executor.on_manoeuvre(name, mission, reason, now_ns), now_ns)

    def on_reaction(self, reason: str, action: str, now_ns: int) -> list[Action]:
        """Plays a built-in mission that no operator ordered, unless a stronger one runs or is about to."""
        if action not in self._built_in:
            return []
        discarded = self._discard_all(reason, now_ns)
        return self._settle(discarded + self._executor.on_reaction(reason, action, now_ns), now_ns)

    def on_interruption(self, row: str, reason: str, action: str, now_ns: int) -> list[Action]:
        """Suspends the mission for a built-in mission; it continues when that and the reaction have ended."""
        if self.phase not in {MissionPhase.READY, MissionPhase.RUNNING}:
            return self.on_reaction(reason, action, now_ns)
        self._interruption = row, reason, action
        suspended = self._executor.suspend(f"{action}: {reason}", now_ns)
        return self._settle(suspended, now_ns)

    def on_reaction_over(self, row: str, now_ns: int) -> list[Action]:
        """The condition of a row does not hold any more."""
        if row != self._blocked_by:
            return []
        self._blocked_by = ""
        return self._settle([], now_ns)

    def _interrupt(self, now_ns: int) -> list[Action]:
        """Plays the built-in mission of a reaction in place of the run that was suspended for it."""
        if self._interruption is None:
            return []
        self._blocked_by, reason, action = self._interruption
        self._interruption = None
        return self._executor.on_reaction(reason, action, now_ns)

    def _discard(self, epoch: int, reason: str, now_ns: int) -> list[Action]:
        """Removes a run from the queue."""
        one = self._queue.take(epoch)
        if one.is_waiting:
            return [_step(one, "state:idle", f"not started: {reason}")]
        return one.executor.discard(reason, now_ns)

    def _discard_all(self, reason: str, now_ns: int) -> list[Action]:
        self._interruption, self._blocked_by = None, ""
        return [step for epoch in self._queue.epochs for step in self._discard(epoch, reason, now_ns)]

    # -- events of the played run

    def on_states(
        self, states: Iterable[tuple[str, MissionState, tuple[BarrierResult, ...]]], now_ns: int
    ) -> list[Action]:
        """States of several platforms were received at the same instant."""
        self._listen(now_ns)
        received = list(states)
        for one in self._queue:  # the barriers of a suspended run continue without it
            one.executor.on_states(received, now_ns)
        return self._settle(self._executor.on_states(received, now_ns), now_ns)

    def on_alive(self, platform: str, now_ns: int) -> list[Action]:
        """A platform has a route, even if its mission state was lost."""
        for one in self._queue:
            one.executor.on_alive(platform, now_ns)
        return self._executor.on_alive(platform, now_ns)

    def on_ended(self, token: int, result: BlockOutcome, text: str, now_ns: int) -> list[Action]:
        """A functional block has ended."""
        return self._settle(self._executor.on_ended(token, result, text, now_ns), now_ns)

    def report(self, token: int, ratio: float, text: str) -> None:
        """A functional block reports its progress."""
        self._executor.report(token, ratio, text)

    def on_control(self, control: ControlState, now_ns: int) -> list[Action]:
        """Takes the driver of the vehicle; the mission is held while a person drives."""
        return self._settle(self._executor.on_control(control, now_ns), now_ns)

    def on_timer(self, now_ns: int) -> list[Action]:
        """Handles time-outs, common times, lost members and requirements."""
        self._listen(now_ns)
        return self._settle(self._executor.on_timer(now_ns), now_ns)

    def deadline_ns(self) -> int:
        """When `on_timer` must be called."""
        announce_ns, run_ns = self._announcer.deadline_ns(), self._executor.deadline_ns()
        if announce_ns is None:
            return AT_ONCE
        return announce_ns if run_ns is None else min(run_ns, announce_ns)

    def _listen(self, now_ns: int) -> None:
        """Extends the time-outs of others by the delay of this core, during which it received nothing."""
        if late_ns := self._commons.delay.on_turn(self.deadline_ns(), now_ns):
            for executor in (self._executor, *(one.executor for one in self._queue)):
                executor.extend_waits(late_ns)

    # -- whose turn it is

    def _settle(self, actions: list[Action], now_ns: int) -> list[Action]:
        """Completes an event: the run whose turn it is plays, and the state is announced."""
        while not self._hindrance():
            played = self._played
            if self.phase is MissionPhase.SUSPENDED and played is not None:
                self._queue.put(played)
                self._played, self._executor = None, self._make()
                actions += self._interrupt(now_ns)
                continue
            if (first := self._queue.first) is None:
                break
            if self.phase in INACTIVE:
                has_ended = len(self.members) > 1 and self.phase is not MissionPhase.IDLE
                if has_ended and not self._announcer.has_repeated(self.state()):
                    break  # others may still need the result of the last barrier
                self._queue.take(first.run.epoch)
                actions += self._call(first, now_ns)
            elif played is not None and self._precedes(first, played):
                reason = f"{first.run.name} ({first.run.epoch}) of priority {first.priority} comes first"
                actions += played.executor.suspend(reason, now_ns)
                actions.append(_step(first, "preempts", f"{played.run.name} ({played.run.epoch})"))
                if self.phase is not MissionPhase.SUSPENDED:
                    break  # its blocks have not ended; the last end settles again
            else:
                break
        state = self.state()
        if self._announcer.due(state, now_ns):
            actions.append(Announce(state))
        return actions

    def _precedes(self, first: QueuedRun, played: QueuedRun) -> bool:
        """Whether the first run of the queue takes the place of the played one."""
        if self.phase is MissionPhase.READY:
            return first.rank < played.rank and not self._executor.is_beginning
        return self.phase is MissionPhase.RUNNING and first.priority > played.priority

    def _call(self, one: QueuedRun, now_ns: int) -> list[Action]:
        """The turn of a run has come: it begins, or continues."""
        self._played, self._executor = one, one.executor
        if not one.is_waiting:
            return one.executor.resume(now_ns)
        try:
            return one.executor.on_order(one.run, now_ns)
        except SwarmError as error:  # a requirement that was met when the order was accepted
            return one.executor.refuse(one.run, str(error), now_ns)


def _step(one: QueuedRun, event: str, text: str) -> ProgressStep:
    return ProgressStep("", "Mission", event, text, one.run.name, one.run.epoch)
