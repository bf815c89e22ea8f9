"""Searches for deadlocks and failures of an ensemble at its barriers, over all behaviours of its members.

It explores the product of the members' nets. Between two barriers a member does not depend on others, so only
the results count; at a barrier it continues when the barrier opens, breaks or times out. A role that several
platforms may have is explored with several members. A state in which no member can continue, and not all have
ended, is a deadlock. A barrier that breaks without a successor fails its mission: an ensemble in which that
happens in every run without a fault is refused.
"""

from collections import deque
from collections.abc import Iterator
from typing import Final

import msgspec

from swarmware.mission.budget import Budget
from swarmware.mission.catalogue import Barrier
from swarmware.mission.net import Faults, Marking, Net, build
from swarmware.mission.outcome import BARRIER_BROKEN, SUCCESS, TIMED_OUT, BlockOutcome
from swarmware.mission.parallel import merge
from swarmware.mission.participant import Participant, RoleSteps, gates_of
from swarmware.mission.reduction import reduce

AHEAD_LIMIT: Final = 3
"""Maximum difference of the visits of a barrier between two members: a larger one is treated as equal."""

_STATE: Final = 600
"""Memory of a visited state of the ensemble without its members, in bytes."""
_MEMBER: Final = 200
"""Memory of a member in such a state, in bytes."""

_MOVE: Final = 1_200
_VISIT: Final = 60
"""Budget of a move, and of each number of visits in it, in bytes: accounts for its time."""

BarrierVisit = tuple[int, int]
"""Number of a barrier, and of the visit."""
State = tuple[Marking, tuple[int, ...]]
"""State of a member: marking of its net (0: its mission has ended), visits of each barrier."""
DecidedVisits = tuple[tuple[BarrierVisit, bool], ...]
"""Decided barrier visits at which a member may still arrive, and whether they opened."""
EnsembleState = tuple[tuple[tuple[State, ...], ...], DecidedVisits]
"""States of the members by role, sorted, because members of one role are interchangeable."""
MemberIndex = tuple[int, int]
"""Index of a role, and of a member in it."""
Move = tuple[dict[MemberIndex, tuple[Marking, Marking]], DecidedVisits, str]
"""Members with their new marking and entered barriers, the decided visits, and a label."""


class Deadlock(msgspec.Struct, frozen=True):
    """A deadlock at barriers."""

    role: str
    block: str
    message: str
    trace: tuple[str, ...]


class Failure(msgspec.Struct, frozen=True):
    """A barrier without a successor that breaks in a run in which no block fails."""

    role: str
    block: str
    message: str
    trace: tuple[str, ...]
    certain: bool
    """True if it happens in every run."""


class TooLarge(msgspec.Struct, frozen=True):
    """The budget is exceeded."""

    role: str
    blocks: tuple[str, ...]
    """Barriers of the role; if a member waits at several, the largest set at which it waits at once."""
    at_once: bool = False


def search(parts: list[Participant], budget: Budget) -> Deadlock | Failure | TooLarge | None:
    """The shortest path to a deadlock, else to a failure, or None without either."""
    ensemble = _Ensemble(parts, budget, Faults.ALL)
    if not ensemble.explore():
        return ensemble.widest
    if ensemble.deadlock is not None:
        return ensemble.deadlock
    # without a fault every barrier should open; else handled errors and time-outs are allowed, too
    found: Failure | None = None
    exact = _exact(parts)
    for faults in (Faults.NONE, Faults.HANDLED):
        ensemble = _Ensemble(parts, budget, faults)
        if not ensemble.explore():
            return ensemble.widest
        found = found or ensemble.failure
        exact = exact and not (ensemble.clipped and _quorums(parts))
        if ensemble.succeeds:
            return found or _with_fewer(parts, budget)
        if found and not ensemble.waits:
            break
    return msgspec.structs.replace(found, certain=True) if found and exact else found


def _with_fewer(parts: list[Participant], budget: Budget) -> Failure | None:
    """A failure of as few members as the ensemble may have, where a number of them opens a barrier."""
    few = [part if part.take else msgspec.structs.replace(part, copies=1) for part in parts]
    # without a quorum a smaller ensemble behaves like the whole one
    if few == parts or not _quorums(parts):
        return None
    ensemble = _Ensemble(few, budget, Faults.NONE)
    ensemble.explore()
    return ensemble.failure


def _quorums(parts: list[Participant]) -> bool:
    """Whether a number of members suffices at some barrier."""
    return any(
        isinstance(block.params, Barrier) and block.params.quorum != "all"
        for part in parts
        for block in part.mission.barriers
    )


def _exact(parts: list[Participant]) -> bool:
    """Whether the search has as many members as the ensemble, where their number has an effect."""
    return not _quorums(parts) or all(part.copies == part.take or part.station for part in parts)


def _nets(parts: list[Participant], budget: Budget, faults: Faults) -> list[Net]:
    """The reduced nets of the roles."""
    gates = [gates_of(part.mission) for part in parts]
    # between barriers only the results count, and all Ends are equal
    nets = [reduce(build(part.mission, faults), own, budget) for part, own in zip(parts, gates, strict=True)]
    return merge(nets, gates)


class _Ensemble:
    """Breadth-first search over the states of all members together."""

    def __init__(self, parts: list[Participant], budget: Budget, faults: Faults) -> None:
        nets = _nets(parts, budget, faults)
        self._names = sorted(
            {
                block.params.id
                for part, net in zip(parts, nets, strict=True)
                for place, block in gates_of(part.mission).items()
                if place in net.owner and isinstance(block.params, Barrier)
            }
        )
        numbers = {name: number for number, name in enumerate(self._names)}
        self._roles = [
            RoleSteps(part, net, faults, numbers, budget) for part, net in zip(parts, nets, strict=True)
        ]
        self._budget = budget
        self._faults = faults
        stations = {part.role for part in parts if part.station}
        self._strict = {
            number
            for role in self._roles
            for _, barrier, number in role.gates.values()
            if stations.intersection(barrier.roles)
        }
        """Barriers that need the ground station."""
        self._came: dict[EnsembleState, tuple[EnsembleState | None, str]] = {}
        self._queue: deque[EnsembleState] = deque()
        self.deadlock: Deadlock | None = None
        self.failure: Failure | None = None
        """The first barrier that broke and had no successor, where only handled faults are explored."""
        self.clipped = False
        """Whether a difference of visits was taken to be smaller than it is."""
        self.waits = False
        """Whether members can wait for each other until a time-out ends that."""
        self._failed = False
        self.succeeds = False
        """Whether all members can end without such a failure."""
        first = next((part for part in parts if part.mission.barriers), parts[0])
        self.widest = TooLarge(first.role, tuple(gates_of(first.mission)) or (first.mission.start,))

    def explore(self) -> bool:
        """Search until a deadlock is found, or, without unhandled faults, a success and a failure.

        Returns whether the budget sufficed.
        """
        no_visits = tuple(0 for _ in self._names)
        start: EnsembleState = (
            tuple(((role.bits.start, no_visits),) * role.copies for role in self._roles),
            (),
        )
        self._came[start] = (None, "")
        self._queue.append(start)
        while self._queue and self.deadlock is None and not self._budget.spent:
            # Both answers are known: some runs succeed, so the failure is not certain.
            if self.succeeds and self.failure:
                break
            now = self._queue.popleft()
            self._failed = False
            moves = list(self._moves(now))
            if not moves and not self._failed:
                running = any(marking for members in now[0] for marking, _ in members)
                self.succeeds = self.succeeds or not running
                self.waits = self.waits or running
                # with all faults a time-out would have ended the wait, so nothing can
                if running and self._faults is Faults.ALL:
                    self.deadlock = self._explain(now)
            for move in moves:
                self._go(now, move)
        return not self._budget.spent

    def _moves(self, now: EnsembleState) -> Iterator[Move]:
        members, over = now
        for number, role in enumerate(self._roles):
            for index, (marking, _) in enumerate(members[number]):
                if role.is_under_way(marking):
                    # it depends on no other member, so the order of such steps has no effect
                    for result, entered, label in role.results(marking):
                        yield {(number, index): (result, entered)}, over, label
                    return
        waiting: dict[BarrierVisit, list[tuple[int, int, Marking]]] = {}
        for number, role in enumerate(self._roles):
            for index, (marking, visits) in enumerate(members[number]):
                for place in role.gates_of(marking):
                    barrier = role.gates[place][2]
                    waiting.setdefault((barrier, visits[barrier]), []).append((number, index, place))
                for after, entered, label in role.local(marking):
                    yield {(number, index): (after, entered)}, over, f"{role.part.role}: {label}"
        for meeting, group in waiting.items():
            for outcomes, opened, label in self._decisions(now, meeting, group):
                if self._fails(now, meeting, group, outcomes, label):
                    continue
                gone = {
                    (number, index): self._roles[number].leave(members[number][index][0], place, outcome)
                    for (number, index, place), outcome in zip(group, outcomes, strict=True)
                }
                # The visit stays decided: members that come later get the same result.
                yield gone, (*over, (meeting, opened)), f"{self._names[meeting[0]]!r} {label}"

    def _decisions(
        self, now: EnsembleState, meeting: BarrierVisit, group: list[tuple[int, int, Marking]]
    ) -> Iterator[tuple[list[BlockOutcome], bool, str]]:
        """Possible results of a barrier visit for the members that wait there."""
        members, over = now
        barrier, visit = meeting
        known = dict(over).get(meeting)
        if known is not None:
            yield [SUCCESS if known else BARRIER_BROKEN] * len(group), known, "was over"
            return
        gates = [self._roles[number].gates[place] for number, _, place in group]
        _, params, _ = gates[0]
        participants = [
            state
            for role, states in zip(self._roles, members, strict=True)
            if not params.roles or role.part.role in params.roles
            for state in states
            if state[0] or not role.part.station or barrier in self._strict
        ]
        # the search has fewer members than the ensemble: a quorum above them means all
        needed = min(params.quorum, len(participants)) if params.quorum != "all" else len(participants)
        gone = sum(1 for marking, _ in participants if not marking)
        # a member that has passed this visit never comes to it again
        ahead = any(marking and visits[barrier] > visit for states in members for marking, visits in states)
        if len(group) >= needed:
            yield [SUCCESS] * len(group), True, "opened"
            if params.quorum == "all" and len(participants) > 1 and self._faults is Faults.ALL:
                # a late member represents all members in the same state
                alike = {(n, members[n][i]): number for number, (n, i, _) in enumerate(group)}
                for late in alike.values():
                    yield (
                        [BARRIER_BROKEN if n == late else SUCCESS for n in range(len(group))],
                        True,
                        "opened, one was late",
                    )
        elif len(participants) - gone < needed or ahead:
            yield [BARRIER_BROKEN] * len(group), False, "broke"
        for first, (block, _, _) in enumerate(gates):
            if block.timeout_s is not None and self._faults is not Faults.NONE:
                outcomes = [TIMED_OUT if n == first else BARRIER_BROKEN for n in range(len(group))]
                yield outcomes, False, "timed out"

    def _fails(
        self,
        now: EnsembleState,
        meeting: BarrierVisit,
        group: list[tuple[int, int, Marking]],
        outcomes: list[BlockOutcome],
        label: str,
    ) -> bool:
        """Whether a mission fails by this result; where all faults are explored, that is one of them."""
        if self._faults is Faults.ALL:
            return False
        for (number, _, place), outcome in zip(group, outcomes, strict=True):
            role = self._roles[number]
            block, params, _ = role.gates[place]
            if block.follower(outcome) is not None:
                continue
            self._failed = True
            if self.failure is None:
                ended = [
                    other.part.role
                    for other, states in zip(self._roles, now[0], strict=True)
                    if any(not marking for marking, _ in states)
                ]
                why = f": {', '.join(ended)} will not come to it any more" if ended else ""
                trace = (*self._trace(now), f"{params.id!r} {label}")
                self.failure = Failure(role.part.role, block.id, f"{params.id!r} {label}{why}", trace, False)
            return True
        return False

    def _go(self, now: EnsembleState, move: Move) -> None:
        """Enter the state after a move."""
        changed, over, label = move
        members = [list(states) for states in now[0]]
        for (number, index), (marking, entered) in changed.items():
            visits = self._enter(number, marking, entered, members[number][index][1])
            # an error was found, which ends the search
            if visits is None:
                return
            members[number][index] = (marking, visits)
        state = self._normal(members, over)
        self._budget.pay(_MOVE + _VISIT * len(self._names) * sum(map(len, members)))
        # breadth first: the first way to a state is the shortest, which the trace shows
        if state not in self._came:
            self._came[state] = (now, label)
            self._queue.append(state)
            self._budget.pay(_STATE + _MEMBER * sum(map(len, members)))

    def _enter(
        self, number: int, marking: Marking, entered: Marking, visits: tuple[int, ...]
    ) -> tuple[int, ...] | None:
        """Count visits; two simultaneous waits of one mission at one barrier are an error."""
        if not entered:
            return visits
        role = self._roles[number]
        waits = [role.gates[place] for place in role.gates_of(marking)]
        if len(waits) > (len(self.widest.blocks) if self.widest.at_once else 1):
            self.widest = TooLarge(role.part.role, tuple(block.id for block, _, _ in waits), at_once=True)
        counted = list(visits)
        for place in role.gates_of(entered):
            block, params, barrier = role.gates[place]
            counted[barrier] += 1
            if sum(1 for _, _, other in waits if other == barrier) > 1:
                message = f"barrier {params.id!r}: two branches wait there at the same time; expected one"
                self.deadlock = self.deadlock or Deadlock(role.part.role, block.id, message, ())
                return None
        return tuple(counted)

    def _normal(self, members: list[list[State]], over: DecidedVisits) -> EnsembleState:
        """Normal form: visits relative to the slowest member, without visits that no member can reach."""
        behind: list[int] = []
        for barrier in range(len(self._names)):
            live = [
                visits[barrier]
                for role, states in zip(self._roles, members, strict=True)
                if barrier in role.visited
                for marking, visits in states
                if marking
            ]
            # Only differences of visits matter: without this, loops would give new states without end.
            behind.append(min(live, default=0))
        no_visits = tuple(0 for _ in behind)
        self.clipped = self.clipped or any(
            visit - behind[barrier] > AHEAD_LIMIT for (barrier, visit), _ in over
        )
        kept = {
            (barrier, visit - behind[barrier]): opened
            for (barrier, visit), opened in over
            if 0 < visit - behind[barrier] <= AHEAD_LIMIT
        }
        return (
            tuple(
                tuple(
                    sorted(
                        (
                            marking,
                            tuple(
                                min(visit - less, AHEAD_LIMIT)
                                for visit, less in zip(visits, behind, strict=True)
                            )
                            if marking
                            else no_visits,
                        )
                        for marking, visits in states
                    )
                )
                for states in members
            ),
            tuple(sorted(kept.items())),
        )

    def _explain(self, state: EnsembleState) -> Deadlock:
        waits: list[str] = []
        first: tuple[str, str] | None = None
        for role, states in zip(self._roles, state[0], strict=True):
            for marking, _ in states:
                for place in role.gates_of(marking):
                    block, params, _ = role.gates[place]
                    first = first or (role.part.role, block.id)
                    words = f"{role.part.role} at {params.id!r} ({block.id})"
                    if words not in waits:
                        waits.append(words)
        role_name, block_id = first or (self._roles[0].part.role, self._roles[0].part.mission.start)
        message = (
            f"members can wait for each other for ever: {', '.join(waits)}; "
            "expected the same barriers in the same order on every path, or a time-out"
        )
        return Deadlock(role_name, block_id, message, self._trace(state))

    def _trace(self, state: EnsembleState) -> tuple[str, ...]:
        """Choices and meetings that lead to a state."""
        steps: list[str] = []
        before, label = self._came[state]
        while before is not None:
            if label:
                steps.append(label)
            before, label = self._came[before]
        return tuple(reversed(steps))
