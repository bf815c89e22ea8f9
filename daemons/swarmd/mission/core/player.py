"""The player: tokens move through a mission's blocks on events (S4.2, S4.3)."""

from collections.abc import Callable, Iterator
from typing import Final, Literal

import msgspec

from swarmd.mission.core.actions import (
    CancelBlock,
    EnterBarrier,
    LeaveBarrier,
    PlayEnded,
    PlayerAction,
    ProgressStep,
    StartBlock,
)
from swarmware.mission.catalogue import Barrier, DecisionRandom, End, Wait
from swarmware.mission.condition import Lookup
from swarmware.mission.model import CANCELLED, ERROR, OK, STEPS_LIMIT, TIMEOUT, Block, Mission
from swarmware.mission.net import join_place

CANCEL_NS: Final = 2_000_000_000
"""A cancelled block that has not ended by then is abandoned."""

Phase = Literal["idle", "running", "ending", "over"]

TRANSITIONS: Final[dict[tuple[Phase, str], Phase]] = {
    ("idle", "start"): "running",
    ("running", "stop"): "ending",
    ("ending", "empty"): "over",
}


class _Running(msgspec.Struct):
    """A block that holds a token and takes time."""

    block: Block
    token: int
    deadline_ns: int | None
    outcome: str = ""
    """What it will have ended with, once it is cancelled; empty: it runs."""


class Player:
    """Plays one mission once.

    Sound missions only: what the check excludes (two tokens in a block) fails the mission here.
    """

    def __init__(
        self,
        mission: Mission,
        lookup: Lookup,
        chance: Callable[[], float],
        tokens: Iterator[int],
    ) -> None:
        self._mission = mission
        self._lookup = lookup
        self._chance = chance
        self._tokens = tokens
        self._phase: Phase = "idle"
        self._running: dict[int, _Running] = {}
        self._arrived: set[str] = set()
        self._visits: dict[str, int] = {}
        """Of each barrier, by its id."""
        self._entered: set[str] = set()
        self._result = ("", "")
        self._cause = ""
        """What went wrong last, for a mission that then comes to a failed End."""
        self._places: dict[str, frozenset[str]] = {
            join.id: frozenset(
                join_place(block.id, join.id)
                for block in mission.blocks.values()
                if any(edge.target == join.id for edge in block.edges)
            )
            for join in mission.blocks.values()
            if join.type == "Join"
        }

    @property
    def active(self) -> tuple[str, ...]:
        """Blocks that hold a token and take time."""
        return tuple(running.block.id for running in self._running.values())

    @property
    def stopping(self) -> bool:
        """Nothing new begins any more."""
        return self._phase in {"ending", "over"}

    @property
    def progress_ratio(self) -> float:
        """Share of the blocks that were entered."""
        return len(self._entered) / len(self._mission.blocks)

    def start(self, now_ns: int) -> list[PlayerAction]:
        """Puts the token on Start."""
        self._move("start")
        actions: list[PlayerAction] = []
        self._enter("", self._mission.start, now_ns, actions)
        return actions

    def on_outcome(self, token: int, outcome: str, now_ns: int, text: str = "") -> list[PlayerAction]:
        """A block has ended, or a barrier has opened; one that was abandoned is not listened to."""
        running = self._running.pop(token, None)
        if running is None:
            return []
        actions: list[PlayerAction] = []
        self._leave(running, outcome, text, now_ns, actions)
        return actions

    def stop(self, result: Literal["failed", "aborted"], reason: str, now_ns: int) -> list[PlayerAction]:
        """Ends the mission early: everything that runs is cancelled."""
        actions: list[PlayerAction] = []
        if self._phase == "running":
            self._end(result, reason, now_ns, actions)
        return actions

    def on_timer(self, now_ns: int) -> list[PlayerAction]:
        """Pauses that are over, blocks that take too long, cancelled ones that do not end."""
        actions: list[PlayerAction] = []
        for running in list(self._running.values()):
            if running.deadline_ns is None or running.deadline_ns > now_ns:
                continue
            if running.token not in self._running:
                continue  # an earlier one of this round has ended the mission
            if running.outcome:
                del self._running[running.token]
                actions.append(ProgressStep(running.block.id, running.block.type, "abandoned"))
                self._leave(running, "abandoned", "", now_ns, actions)
            elif running.block.type == "Wait":
                del self._running[running.token]
                self._leave(running, OK, "", now_ns, actions)
            else:
                self._cancel(running, TIMEOUT, now_ns, actions)
        return actions

    def deadline_ns(self) -> int | None:
        """When `on_timer` must be called."""
        return min((r.deadline_ns for r in self._running.values() if r.deadline_ns is not None), default=None)

    def _move(self, event: str) -> None:
        self._phase = TRANSITIONS[self._phase, event]

    def _enter(self, source: str, target: str, now_ns: int, actions: list[PlayerAction]) -> None:
        """Moves a token to a block, and on through all that take no time."""
        work = [(source, target)]
        for _ in range(STEPS_LIMIT):
            if not work or self._phase != "running":
                return
            source, target = work.pop()
            block = self._mission.blocks[target]
            self._entered.add(target)
            match block.type:
                case "End":
                    actions.append(ProgressStep(block.id, block.type, OK))
                    result = block.params.result if isinstance(block.params, End) else "done"
                    why = f": {self._cause}" if self._cause else ""
                    self._end(result, "" if result == "done" else f"came to {block.id}{why}", now_ns, actions)
                    return
                case "Join":
                    self._arrived.add(join_place(source, target))
                    places = self._places[target]
                    if not places <= self._arrived:
                        continue
                    self._arrived -= places
                    outcomes = [OK]
                case "Fork":
                    outcomes = [edge.outcome for edge in block.edges]
                case "Decision":
                    outcomes = [self._decide(block)]
                case "DecisionRandom":
                    chance = block.params.chance_for_true if isinstance(block.params, DecisionRandom) else 0.0
                    outcomes = ["true" if self._chance() < chance else "false"]
                case "Start":
                    outcomes = [OK]
                case _:
                    self._begin(block, now_ns, actions)
                    continue
            if block.type != "Start":
                actions.append(
                    ProgressStep(block.id, block.type, OK if block.type == "Fork" else outcomes[0])
                )
            for outcome in reversed(outcomes):
                follower = block.successor(outcome)
                if follower is None:
                    self._end("failed", f"{block.id} ended with {outcome}", now_ns, actions)
                    return
                work.append((target, follower))
        self._end("failed", f"{target} is in a loop that never rests", now_ns, actions)

    def _decide(self, block: Block) -> str:
        for edge in block.edges:
            if edge.condition is not None:
                holds = edge.condition.holds(self._lookup)
                if holds is None:
                    return f"{ERROR}:unknown_value"
                if holds:
                    return edge.outcome
        return OK

    def _begin(self, block: Block, now_ns: int, actions: list[PlayerAction]) -> None:
        if block.id in self.active:
            self._end("failed", f"{block.id} was entered again while it still ran", now_ns, actions)
            return
        token = next(self._tokens)
        seconds = block.params.duration_s if isinstance(block.params, Wait) else block.timeout_s
        deadline_ns = None if seconds is None else now_ns + round(seconds * 1e9)
        actions.append(ProgressStep(block.id, block.type, "started"))
        if block.type == "Barrier":
            # its time-out is the ensemble's business: all members must hear of it
            # one barrier per id, whatever the block: the second block of that id is the second meeting
            barrier = block.params.id if isinstance(block.params, Barrier) else block.id
            visit = self._visits[barrier] = self._visits.get(barrier, 0) + 1
            self._running[token] = _Running(block, token, None)
            actions.append(EnterBarrier(token, block, visit))
            return
        self._running[token] = _Running(block, token, deadline_ns)
        if block.type != "Wait":
            actions.append(StartBlock(token, block))

    def _leave(
        self, running: _Running, outcome: str, text: str, now_ns: int, actions: list[PlayerAction]
    ) -> None:
        block = running.block
        outcome = running.outcome or outcome
        actions.append(ProgressStep(block.id, block.type, outcome, text))
        if self._phase == "ending":
            self._check_empty(actions)
            return
        reason = f"{block.id} ended with {outcome}" + (f": {text}" if text else "")
        if outcome != OK:
            self._cause = reason
        follower = block.successor(outcome)
        if follower is None:
            self._end("failed", reason, now_ns, actions)
        else:
            self._enter(block.id, follower, now_ns, actions)

    def _cancel(self, running: _Running, outcome: str, now_ns: int, actions: list[PlayerAction]) -> None:
        if running.block.type in {"Wait", "Barrier"}:
            del self._running[running.token]
            actions.append(ProgressStep(running.block.id, running.block.type, outcome))
            if running.block.type == "Barrier":
                actions.append(LeaveBarrier(running.token))
            return
        if not running.outcome:
            running.deadline_ns = now_ns + CANCEL_NS
            actions.append(CancelBlock(running.token))
        running.outcome = outcome

    def _end(self, result: str, reason: str, now_ns: int, actions: list[PlayerAction]) -> None:
        self._move("stop")
        self._result = (result, reason)
        self._arrived.clear()
        for running in list(self._running.values()):
            self._cancel(running, CANCELLED, now_ns, actions)
        self._check_empty(actions)

    def _check_empty(self, actions: list[PlayerAction]) -> None:
        if not self._running and self._phase == "ending":
            self._move("empty")
            actions.append(PlayEnded(*self._result))
