"""A role in the search for deadlocks at barriers: its net, and the steps in it up to the next barrier."""

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Final

import msgspec

from swarmware.mission.budget import Budget
from swarmware.mission.catalogue import Barrier
from swarmware.mission.model import Block, MissionDefinition
from swarmware.mission.net import PLACES_PER_BYTE, Bits, Faults, Firing, Marking, Net
from swarmware.mission.outcome import BARRIER_BROKEN, SUCCESS, TIMED_OUT, BlockOutcome

_RESULT: Final = 200
"""Memory of a state between two barriers, in bytes."""
CHOICES_SHOWN: Final = 8
"""Maximum choices of a member between two barriers in a counter-example."""


class Participant(msgspec.Struct, frozen=True):
    """A role in the search."""

    role: str
    mission: MissionDefinition
    copies: int
    """Number of its members in the search."""
    take: int = 0
    """Number of its members in the ensemble, or 0 for any number."""
    station: bool = False
    """A ground station: a barrier that does not name its role does not need a lost one."""


def gates_of(mission: MissionDefinition) -> dict[str, Block]:
    """The barriers of a mission by their place."""
    return {block.id: block for block in mission.barriers}


class RoleSteps:
    """The net of a role, and the steps in it up to the next barrier."""

    def __init__(
        self, part: Participant, net: Net, faults: Faults, numbers: Mapping[str, int], budget: Budget
    ) -> None:
        self.part = part
        self._faults = faults
        self.bits = Bits(net)
        self.gates: dict[Marking, tuple[Block, Barrier, int]] = {
            self.bits.of[place]: (block, block.params, numbers[block.params.id])
            for place, block in gates_of(part.mission).items()
            if place in net.owner and isinstance(block.params, Barrier)
        }
        self.visited = frozenset(number for _, _, number in self.gates.values())
        self._barriers = sum(self.gates)
        self._budget = budget
        self._results: dict[Marking, dict[Marking, str]] = {}

    @property
    def copies(self) -> int:
        """Number of members in the search: one, if all behave in the same way."""
        # with a quorum the number of members decides, so equal members cannot be merged
        if any(barrier.quorum != "all" for _, barrier, _ in self.gates.values()):
            return self.part.copies
        seen: set[Marking] = set()
        queue = [self.bits.start]
        while queue:
            # a member that ends makes no other one wait for ever, but fails those that continue to a barrier
            ways = {
                result
                for result, _, _ in self.results(queue.pop())
                if result or self._faults is not Faults.ALL
            }
            if len(ways) > 1:
                return self.part.copies
            for marking in ways - seen - {0}:
                seen.add(marking)
                gates = self.gates_of(marking)
                if len(gates) > 1 or next(self.local(marking), None):
                    return self.part.copies
                for outcome in (SUCCESS, BARRIER_BROKEN, TIMED_OUT):
                    after, _ = self.leave(marking, gates[0], outcome)
                    if outcome == SUCCESS and after:
                        queue.append(after)
                    elif after and any(result for result, _, _ in self.results(after)):
                        return self.part.copies
        return 1

    def gates_of(self, marking: Marking) -> list[Marking]:
        """Places of the barriers at which the member waits."""
        found: list[Marking] = []
        rest = marking & self._barriers
        while rest:
            # the lowest set bit, which the next line removes
            found.append(rest & -rest)
            rest &= rest - 1
        return found

    def local(self, marking: Marking) -> Iterator[tuple[Marking, Marking, str]]:
        """Steps of the member that do not depend on others: marking, entered barriers, label."""
        for step in self.bits.steps(marking):
            if not step.inputs & self._barriers:
                result = _fire(marking, step)
                words = step.labels if result else (*step.labels, "ends")
                yield result, step.outputs & self._barriers if result else 0, " → ".join(words)

    def leave(self, marking: Marking, place: Marking, outcome: BlockOutcome) -> tuple[Marking, Marking]:
        """The member leaves a barrier: its marking and the entered barriers."""
        block = self.gates[place][0]
        target = block.follower(outcome)
        edges = {edge.outcome for edge in block.edges if edge.target == target}
        for step in self.bits.steps(place):
            if step.outcome in edges:
                return marking & ~place | step.outputs, step.outputs & self._barriers
        return 0, 0

    def is_under_way(self, marking: Marking) -> bool:
        """Whether the member does not wait at a barrier, so it continues independently of others."""
        return marking != 0 and not marking & self._barriers

    def results(self, marking: Marking) -> Iterator[tuple[Marking, Marking, str]]:
        """Reachable states at barriers or at the end: marking, entered barriers, choices on the way."""
        if not self.is_under_way(marking):
            yield marking, marking & self._barriers, ""
            return
        if marking not in self._results:
            self._results[marking] = self._run(marking)
        for result, label in self._results[marking].items():
            yield result, result & self._barriers, label

    def _run(self, marking: Marking) -> dict[Marking, str]:
        found: dict[Marking, str] = {}
        came: dict[Marking, tuple[str, ...]] = {marking: ()}
        queue = deque([marking])
        while queue and not self._budget.spent:
            now = queue.popleft()
            # ended or at a barrier: the next step depends on others
            if not now or now & self._barriers:
                words = [*came[now], *([] if now else ["ends"])]
                found[now] = f"{self.part.role}: {' → '.join(words)}" if words else ""
                continue
            for step in self.bits.steps(now):
                result = _fire(now, step)
                if result not in came:
                    # only labels with an outcome are choices; the others follow by themselves
                    choices = tuple(label for label in step.labels if ":" in label)
                    came[result] = (*came[now], *choices)[-CHOICES_SHOWN:]
                    queue.append(result)
                    self._budget.pay(_RESULT + len(self.bits.places) // PLACES_PER_BYTE)
        return found


def _fire(marking: Marking, step: Firing) -> Marking:
    """The marking after the step, or 0 if the mission has ended."""
    return marking & ~step.inputs | step.outputs if step.outputs else 0
