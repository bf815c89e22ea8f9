"""The player: tokens move through a mission's blocks on events (S4.2, S4.3)."""

from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import Final

import msgspec

from swarmd.mission.core.run import (
    RESUMED,
    STARTED,
    CancelBlock,
    EnterBarrier,
    LeaveBarrier,
    PlayEnded,
    PlayerAction,
    PlayResult,
    PlaySuspended,
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
    PREEMPTED,
    SUCCESS,
    SUSPENDED,
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
    SUSPENDING = "suspending"
    """No further block begins; the cancelled blocks will continue later."""
    SUSPENDED = "suspended"
    ENDING = "ending"
    """No further block begins; cancelled blocks have not ended yet."""
    OVER = "over"


NEXT: Final[dict[PlayerPhase, tuple[PlayerPhase, ...]]] = {
    PlayerPhase.IDLE: (PlayerPhase.RUNNING,),
    PlayerPhase.RUNNING: (PlayerPhase.SUSPENDING, PlayerPhase.ENDING),
    PlayerPhase.SUSPENDING: (PlayerPhase.SUSPENDED, PlayerPhase.ENDING),
    PlayerPhase.SUSPENDED: (PlayerPhase.RUNNING, PlayerPhase.ENDING),
    PlayerPhase.ENDING: (PlayerPhase.OVER,),
    PlayerPhase.OVER: (),
}
"""Phases that may follow each phase."""


class _Running(msgspec.Struct):
    """A block that holds a token and takes time."""

    block: Block
    token: int
    deadline_ns: int | None
    result: BlockOutcome | None = None
    """Result of the block once it is cancelled, or None while it runs."""
    visit: int = 0
    """Number of the visit of a Barrier, from 1, or 0 for other blocks."""


class _Parked(msgspec.Struct):
    """A block that holds a token of a suspended mission."""

    block: Block
    result: BlockOutcome | None = None
    """Result of the block if it ended while the mission was being suspended."""
    text: str = ""
    visit: int = 0
    remaining_ns: int | None = None
    """Remaining time of a Wait, or None for other blocks."""


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
        self._parked: list[_Parked] = []
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
        return (
            *(running.block.id for running in self._running.values()),
            *(parked.block.id for parked in self._parked),
        )

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
        if self._phase in {PlayerPhase.RUNNING, PlayerPhase.SUSPENDING, PlayerPhase.SUSPENDED}:
            self._end(result, reason, now_ns)
        return self._taken()

    def suspend(self, now_ns: int) -> list[PlayerAction]:
        """Stops all blocks, and keeps the tokens until `resume`."""
        if self._phase is not PlayerPhase.RUNNING:
            return self._taken()
        self._move(PlayerPhase.SUSPENDING)
        for running in list(self._running.values()):
            if running.result is not None:
                continue  # cancelled at its time-out, which stays its result
            match running.block.type:
                case BlockName.WAIT:
                    rest_ns = (running.deadline_ns or now_ns) - now_ns
                    self._park(running, None, remaining_ns=max(rest_ns, 0))
                case BlockName.BARRIER:
                    # it arrives again on resume, with the same visit, so that the others still count it
                    self._actions.append(LeaveBarrier(running.token))
                    self._park(running, None)
                case _:
                    self._cancel(running, SUSPENDED, now_ns)
        self._check_empty()
        return self._taken()

    def resume(self, now_ns: int) -> list[PlayerAction]:
        """Continues after `suspend`: each block by its value of `resume`."""
        self._move(PlayerPhase.RUNNING)
        while self._parked and self._phase is PlayerPhase.RUNNING:
            parked = self._parked.pop(0)
            if parked.result is not None:
                self._follow(parked.block, parked.result, parked.text, now_ns)
            elif parked.block.resume in {"restart", "continue"}:
                self._begin(parked.block, now_ns, parked)
            else:
                result = SUCCESS if parked.block.resume == "skip" else PREEMPTED
                self._actions.append(ProgressStep(parked.block.id, parked.block.type, result.label))
                self._follow(parked.block, result, "it was suspended", now_ns)
        return self._taken()

    def _park(
        self,
        running: _Running,
        result: BlockOutcome | None,
        text: str = "",
        remaining_ns: int | None = None,
    ) -> None:
        self._running.pop(running.token, None)
        self._parked.append(_Parked(running.block, result, text, running.visit, remaining_ns))
        label = SUSPENDED.label if result is None else result.label
        self._actions.append(ProgressStep(running.block.id, running.block.type, label, text))

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
        if phase not in NEXT[self._phase]:
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
            # the last item is taken next: reversed, the branches of a Fork begin in the order of the file
            for outcome in reversed(outcomes):
                follower = block.successor(outcome)
                if follower is None:
                    self._end(PlayResult.FAILED, f"{block.id} ended with {outcome.label}", now_ns)
                    return
                work.append((target, follower))
        # a loop of decisions without a block that takes time would occupy the event loop for ever
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

    def _begin(self, block: Block, now_ns: int, parked: _Parked | None = None) -> None:
        if block.id in self.active:
            self._end(PlayResult.FAILED, f"{block.id} was entered again while it still ran", now_ns)
            return
        token = next(self._tokens)
        seconds = block.params.duration_s if isinstance(block.params, Wait) else block.timeout_s
        lasts_ns = None if seconds is None else round(seconds * 1e9)
        if parked is not None and parked.remaining_ns is not None and block.resume == "continue":
            lasts_ns = parked.remaining_ns
        deadline_ns = None if lasts_ns is None else now_ns + lasts_ns
        self._actions.append(ProgressStep(block.id, block.type, STARTED if parked is None else RESUMED))
        if block.type == BlockName.BARRIER:
            # `Barriers` handles its time-out: it breaks the barrier for all members
            # blocks with the same id are visits of one barrier
            barrier = block.params.id if isinstance(block.params, Barrier) else block.id
            visit = self._visits.get(barrier, 0) + 1 if parked is None else parked.visit
            self._visits[barrier] = visit
            self._running[token] = _Running(block, token, None, visit=visit)
            self._actions.append(EnterBarrier(token, block, visit))
            return
        self._running[token] = _Running(block, token, deadline_ns)
        if block.type != BlockName.WAIT:
            self._actions.append(StartBlock(token, block))

    def _leave(self, running: _Running, result: BlockOutcome, text: str, now_ns: int) -> None:
        block = running.block
        if self._phase is PlayerPhase.SUSPENDING:
            # a time-out that came before the suspension stays the result of the block
            if running.result is not None and running.result != SUSPENDED:
                result = running.result
            self._park(running, None if result in {CANCELLED, SUSPENDED} else result, text)
            self._check_empty()
            return
        result = running.result or result
        self._actions.append(ProgressStep(block.id, block.type, result.label, text))
        if self._phase is PlayerPhase.ENDING:
            self._check_empty()
            return
        self._follow(block, result, text, now_ns)

    def _follow(self, block: Block, result: BlockOutcome, text: str, now_ns: int) -> None:
        """Moves the token of a block that has ended on."""
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
        self._parked.clear()
        for running in list(self._running.values()):
            self._cancel(running, CANCELLED, now_ns)
        self._check_empty()

    def _check_empty(self) -> None:
        if not self._running and self._phase is PlayerPhase.ENDING:
            self._move(PlayerPhase.OVER)
            self._actions.append(self._ended)
        elif not self._running and self._phase is PlayerPhase.SUSPENDING:
            self._move(PlayerPhase.SUSPENDED)
            self._actions.append(PlaySuspended())
