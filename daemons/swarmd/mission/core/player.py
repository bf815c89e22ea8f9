"""The player: tokens move through a mission's blocks on events (S4.2, S4.3)."""

from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import Final

import msgspec

from swarmd.mission.core.run import (
    STARTED,
    CancelBlock,
    EnterBarrier,
    LeaveBarrier,
    PlayEnded,
    PlayerAction,
    PlayResult,
    ProgressStep,
    StartBlock,
)
from swarmware.errors import Conflict
from swarmware.mission.catalogue import Barrier, BlockName, DecisionRandom, End, Wait
from swarmware.mission.condition import Lookup
from swarmware.mission.model import STEPS_LIMIT, Block, MissionDefinition
from swarmware.mission.net import join_place
from swarmware.mission.outcome import (
    ABANDONED,
    CANCELLED,
    SUCCESS,
    TIMED_OUT,
    UNKNOWN_VALUE,
    BlockOutcome,
    OutcomeKind,
)

CANCEL_NS: Final = 2_000_000_000
"""A cancelled block that has not ended by then is abandoned."""


class PlayerPhase(StrEnum):
    """Phase of one play."""

    IDLE = "idle"
    RUNNING = "running"
    ENDING = "ending"
    """No further block begins; cancelled blocks have not ended yet."""
    OVER = "over"


NEXT: Final = {
    PlayerPhase.IDLE: PlayerPhase.RUNNING,
    PlayerPhase.RUNNING: PlayerPhase.ENDING,
    PlayerPhase.ENDING: PlayerPhase.OVER,
}
"""Transitions of the phases: each is entered at most once, in this order."""


class _Running(msgspec.Struct):
    """A block that holds a token and takes time."""

    block: Block
    token: int
    deadline_ns: int | None
    result: BlockOutcome | None = None
    """Its result once it is cancelled; None: it runs."""


class Player:
    """Plays one mission once.

    For checked missions only: what the check excludes (two tokens in a block) fails the mission here.
    """

    def __init__(
        self,
        mission: MissionDefinition,
        lookup: Lookup,
        chance: Callable[[], float],
        tokens: Iterator[int],
    ) -> None:
        self._mission = mission
        self._lookup = lookup
        self._chance = chance
        self._tokens = tokens
        self._phase = PlayerPhase.IDLE
        self._actions: list[PlayerAction] = []
        """Actions that result from the current event."""
        self._running: dict[int, _Running] = {}
        self._arrived: set[str] = set()
        self._visits: dict[str, int] = {}
        """Number of visits of each barrier, by its id."""
        self._entered: set[str] = set()
        self._ended = PlayEnded(PlayResult.DONE)
        self._cause = ""
        """The newest error: the reason when the mission reaches a failed End."""
        self._places: dict[str, frozenset[str]] = {
            join.id: frozenset(
                join_place(block.id, join.id)
                for block in mission.blocks.values()
                if any(edge.target == join.id for edge in block.edges)
            )
            for join in mission.blocks.values()
            if join.type == BlockName.JOIN
        }

    @property
    def active(self) -> tuple[str, ...]:
        """Blocks that hold a token and take time."""
        return tuple(running.block.id for running in self._running.values())

    @property
    def stopping(self) -> bool:
        """Whether the play is ending: no further block begins."""
        return self._phase in {PlayerPhase.ENDING, PlayerPhase.OVER}

    @property
    def progress_ratio(self) -> float:
        """Share of the blocks that were entered."""
        return len(self._entered) / len(self._mission.blocks)

    def start(self, now_ns: int) -> list[PlayerAction]:
        """Starts the play: puts the token on Start."""
        self._move(PlayerPhase.RUNNING)
        self._enter("", self._mission.start, now_ns)
        return self._taken()

    def on_ended(self, token: int, result: BlockOutcome, now_ns: int, text: str = "") -> list[PlayerAction]:
        """A block or a wait at a barrier has ended; the end of an abandoned block is ignored."""
        running = self._running.pop(token, None)
        if running is None:
            return []
        self._leave(running, result, text, now_ns)
        return self._taken()

    def stop(self, result: PlayResult, reason: str, now_ns: int) -> list[PlayerAction]:
        """Ends the mission early: cancels all running blocks."""
        if self._phase is PlayerPhase.RUNNING:
            self._end(result, reason, now_ns)
        return self._taken()

    def advance(self, now_ns: int) -> list[PlayerAction]:
        """Handles the end of pauses, time-outs of blocks, and cancelled blocks that do not end."""
        for running in list(self._running.values()):
            if running.deadline_ns is None or running.deadline_ns > now_ns:
                continue
            if running.token not in self._running:
                continue  # an earlier block in this loop has ended the mission
            if running.result is not None:
                del self._running[running.token]
                self._actions.append(ProgressStep(running.block.id, running.block.type, ABANDONED.label))
                self._leave(running, running.result, "", now_ns)
            elif running.block.type == BlockName.WAIT:
                del self._running[running.token]
                self._leave(running, SUCCESS, "", now_ns)
            else:
                self._cancel(running, TIMED_OUT, now_ns)
        return self._taken()

    def deadline_ns(self) -> int | None:
        """When `advance` must be called."""
        return min((r.deadline_ns for r in self._running.values() if r.deadline_ns is not None), default=None)

    def _taken(self) -> list[PlayerAction]:
        actions, self._actions = self._actions, []
        return actions

    def _move(self, phase: PlayerPhase) -> None:
        if NEXT.get(self._phase) is not phase:
            raise Conflict(f"play is {self._phase}: it cannot become {phase}")
        self._phase = phase

    def _enter(self, source: str, target: str, now_ns: int) -> None:
        """Moves a token to a block, and further through blocks that take no time."""
        work = [(source, target)]
        for _ in range(STEPS_LIMIT):
            if not work or self._phase is not PlayerPhase.RUNNING:
                return
            source, target = work.pop()
            block = self._mission.blocks[target]
            self._entered.add(target)
            match block.type:
                case BlockName.END:
                    self._actions.append(ProgressStep(block.id, block.type, SUCCESS.label))
                    result = PlayResult(block.params.result if isinstance(block.params, End) else "done")
                    why = f": {self._cause}" if self._cause else ""
                    reason = "" if result is PlayResult.DONE else f"came to {block.id}{why}"
                    self._end(result, reason, now_ns)
                    return
                case BlockName.JOIN:
                    self._arrived.add(join_place(source, target))
                    places = self._places[target]
                    if not places <= self._arrived:
                        continue
                    self._arrived -= places
                    outcomes = [SUCCESS]
                case BlockName.FORK:
                    outcomes = [edge.outcome for edge in block.edges]
                case BlockName.DECISION:
                    outcomes = [self._decide(block)]
                case BlockName.DECISION_RANDOM:
                    chance = block.params.chance_for_true if isinstance(block.params, DecisionRandom) else 0.0
                    kind = OutcomeKind.TRUE if self._chance() < chance else OutcomeKind.FALSE
                    outcomes = [BlockOutcome(kind)]
                case BlockName.START:
                    outcomes = [SUCCESS]
                case _:
                    self._begin(block, now_ns)
                    continue
            if block.type != BlockName.START:
                outcome = SUCCESS if block.type == BlockName.FORK else outcomes[0]
                self._actions.append(ProgressStep(block.id, block.type, outcome.label))
            for outcome in reversed(outcomes):
                follower = block.successor(outcome)
                if follower is None:
                    self._end(PlayResult.FAILED, f"{block.id} ended with {outcome.label}", now_ns)
                    return
                work.append((target, follower))
        self._end(PlayResult.FAILED, f"{target} is in a livelock", now_ns)

    def _decide(self, block: Block) -> BlockOutcome:
        for edge in block.edges:
            if edge.condition is not None:
                holds = edge.condition.holds(self._lookup)
                if holds is None:
                    return UNKNOWN_VALUE
                if holds:
                    return edge.outcome
        return SUCCESS

    def _begin(self, block: Block, now_ns: int) -> None:
        if block.id in self.active:
            self._end(PlayResult.FAILED, f"{block.id} was entered again while it still ran", now_ns)
            return
        token = next(self._tokens)
        seconds = block.params.duration_s if isinstance(block.params, Wait) else block.timeout_s
        deadline_ns = None if seconds is None else now_ns + round(seconds * 1e9)
        self._actions.append(ProgressStep(block.id, block.type, STARTED))
        if block.type == BlockName.BARRIER:
            # `Barriers` handles its time-out: it breaks the barrier for all members
            # blocks with the same id are visits of one barrier
            barrier = block.params.id if isinstance(block.params, Barrier) else block.id
            visit = self._visits[barrier] = self._visits.get(barrier, 0) + 1
            self._running[token] = _Running(block, token, None)
            self._actions.append(EnterBarrier(token, block, visit))
            return
        self._running[token] = _Running(block, token, deadline_ns)
        if block.type != BlockName.WAIT:
            self._actions.append(StartBlock(token, block))

    def _leave(self, running: _Running, result: BlockOutcome, text: str, now_ns: int) -> None:
        block = running.block
        result = running.result or result
        self._actions.append(ProgressStep(block.id, block.type, result.label, text))
        if self._phase is PlayerPhase.ENDING:
            self._check_empty()
            return
        reason = f"{block.id} ended with {result.label}" + (f": {text}" if text else "")
        if result != SUCCESS:
            self._cause = reason
        follower = block.follower(result)
        if follower is None:
            self._end(PlayResult.FAILED, reason, now_ns)
        else:
            self._enter(block.id, follower, now_ns)

    def _cancel(self, running: _Running, result: BlockOutcome, now_ns: int) -> None:
        if running.block.type in {BlockName.WAIT, BlockName.BARRIER}:
            del self._running[running.token]
            self._actions.append(ProgressStep(running.block.id, running.block.type, result.label))
            if running.block.type == BlockName.BARRIER:
                self._actions.append(LeaveBarrier(running.token))
            return
        if running.result is None:
            running.deadline_ns = now_ns + CANCEL_NS
            self._actions.append(CancelBlock(running.token))
        running.result = result

    def _end(self, result: PlayResult, reason: str, now_ns: int) -> None:
        self._move(PlayerPhase.ENDING)
        self._ended = PlayEnded(result, reason)
        self._arrived.clear()
        for running in list(self._running.values()):
            self._cancel(running, CANCELLED, now_ns)
        self._check_empty()

    def _check_empty(self) -> None:
        if not self._running and self._phase is PlayerPhase.ENDING:
            self._move(PlayerPhase.OVER)
            self._actions.append(self._ended)
