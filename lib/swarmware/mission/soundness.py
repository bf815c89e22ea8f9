"""Is a mission sound? Every block can be reached, and from everywhere an End can.

Explores all markings of the mission's net: found are dead blocks, deadlocks, branches that never join or
end, two tokens in one block, loops that never rest, motions cut short by an End.
"""

from collections import deque
from typing import Final

import msgspec

from swarmware.mission.finding import Finding, Severity
from swarmware.mission.model import Mission
from swarmware.mission.net import Net, Transition, build

MARKING_LIMIT: Final = 50_000
"""Markings after which the answer is "unknown" (about two seconds)."""

Marking = frozenset[str]


class Remark(msgspec.Struct, frozen=True):
    """A finding without its line: the caller knows the file."""

    block: str
    severity: Severity
    rule: str
    message: str
    trace: tuple[str, ...] = ()

    def finding(self, file: str, line: int, pointer: str) -> Finding:
        """The finding, with its place."""
        return Finding(file, line, pointer, self.severity, self.rule, self.message, self.trace)


def check(mission: Mission, limit: int = MARKING_LIMIT) -> list[Remark]:
    """All that is unsound about the mission, counter-examples included."""
    return [*_restless(mission), *_Exploration(mission, build(mission), limit).remarks()]


class _Exploration:
    """Breadth first over the markings, so counter-examples are shortest."""

    def __init__(self, mission: Mission, net: Net, limit: int) -> None:
        self._mission = mission
        self._net = net
        self._limit = limit
        first = frozenset({net.start})
        self._came: dict[Marking, tuple[Marking, str] | None] = {first: None}
        self._order: list[Marking] = [first]
        self._after: dict[Marking, list[Marking]] = {}
        self._ends: set[Marking] = set()
        self._fired: set[str] = set()
        self._unsafe: dict[str, Remark] = {}
        self._stuck: list[Marking] = []
        self._cut: dict[str, Remark] = {}
        by_place: dict[str, list[Transition]] = {}
        for transition in net.transitions:
            by_place.setdefault(min(transition.inputs), []).append(transition)
        # every transition is looked at only where its first input is marked
        self._by_place = by_place

    def remarks(self) -> list[Remark]:
        """Explores, then judges."""
        complete = self._explore()
        found = [*self._unsafe.values(), *self._deadlocks()]
        if not complete:
            message = f"more than {self._limit} states: not all were looked at; expected fewer parallel steps"
            return [*found, Remark(self._mission.start, "unknown", "too-large", message)]
        if not self._unsafe:
            found += self._dead()
            found += self._endless()
        return [*found, *self._cut.values()]

    def _explore(self) -> bool:
        queue = deque(self._order)
        while queue:
            marking = queue.popleft()
            after: list[Marking] = []
            for place in marking:
                for transition in self._by_place.get(place, ()):
                    if transition.inputs <= marking:
                        self._fire(marking, transition, after, queue)
            self._after[marking] = after
            if not after and marking not in self._ends:
                self._stuck.append(marking)
            if len(self._came) > self._limit:
                return False
        return True

    def _fire(
        self, marking: Marking, transition: Transition, after: list[Marking], queue: deque[Marking]
    ) -> None:
        self._fired.add(transition.block)
        if not transition.outputs:
            self._ends.add(marking)
            self._cut_short(marking, transition)
            return
        rest = marking - transition.inputs
        twice = rest.intersection(transition.outputs)
        if twice:
            self._two_tokens(marking, transition, min(twice))
            return
        result = rest.union(transition.outputs)
        after.append(result)
        if result not in self._came:
            self._came[result] = (marking, transition.label)
            self._order.append(result)
            queue.append(result)

    def _trace(self, marking: Marking) -> tuple[str, ...]:
        steps: list[str] = []
        step = self._came[marking]
        while step is not None:
            marking, label = step
            steps.append(label)
            step = self._came[marking]
        return tuple(reversed(steps))

    def _two_tokens(self, marking: Marking, transition: Transition, place: str) -> None:
        block = self._net.owner[place]
        if block not in self._unsafe:
            trace = (*self._trace(marking), transition.label)
            message = f"{block!r} is entered again while it still runs: expected a Join before it"
            self._unsafe[block] = Remark(block, "error", "two-tokens", message, trace)

    def _cut_short(self, marking: Marking, end: Transition) -> None:
        for place in sorted(marking - end.inputs):
            block = self._mission.blocks[self._net.owner[place]]
            if block.spec.motion and block.id not in self._cut:
                message = f"the motion {block.id!r} can be cut short by the End {end.block!r}"
                self._cut[block.id] = Remark(
                    block.id, "warning", "cut-short", message, (*self._trace(marking), end.label)
                )

    def _deadlocks(self) -> list[Remark]:
        found: dict[str, Remark] = {}
        for marking in self._stuck:
            for block in sorted({self._net.owner[place] for place in marking}):
                if block in found:
                    continue
                missing = sorted(
                    place.partition("→")[0]
                    for place, owner in self._net.owner.items()
                    if owner == block and place not in marking
                )
                message = (
                    f"deadlock: the Join {block!r} waits for ever for {', '.join(map(repr, missing))}; "
                    "expected every branch to arrive"
                    if missing
                    else f"{block!r} has no way on"
                )
                found[block] = Remark(block, "error", "deadlock", message, self._trace(marking))
                break
        return list(found.values())

    def _dead(self) -> list[Remark]:
        reached = {self._net.owner[place] for marking in self._order for place in marking}
        found: list[Remark] = []
        for block in self._mission.blocks.values():
            if block.id not in reached:
                message = f"{block.id!r} can never be reached: expected a block that leads to it"
                found.append(Remark(block.id, "error", "dead-block", message))
            elif block.id not in self._fired and not self._stuck:
                message = f"{block.id!r} can never be left: not all its branches can arrive together"
                found.append(Remark(block.id, "error", "dead-block", message))
        return found

    def _endless(self) -> list[Remark]:
        before: dict[Marking, list[Marking]] = {}
        for marking, results in self._after.items():
            for result in results:
                before.setdefault(result, []).append(marking)
        can_end = set(self._ends) | set(self._stuck)  # stuck ones have their own remark
        queue = deque(can_end)
        while queue:
            for marking in before.get(queue.popleft(), ()):
                if marking not in can_end:
                    can_end.add(marking)
                    queue.append(marking)
        for marking in self._order:
            if marking not in can_end:
                blocks = sorted({self._net.owner[place] for place in marking})
                message = (
                    f"once in {', '.join(map(repr, blocks))} no End is ever reached: "
                    "expected every branch to join or end"
                )
                return [Remark(blocks[0], "error", "never-ends", message, self._trace(marking))]
        return []


def _restless(mission: Mission) -> list[Remark]:
    """Loops of nothing but instant blocks: the player would never come back from them."""
    after = {
        block.id: [edge.target for edge in block.edges]
        for block in mission.blocks.values()
        if block.spec.instant
    }
    done: set[str] = set()
    for root in after:
        path: list[str] = []
        stack = [(root, 0)]
        while stack:
            block, index = stack.pop()
            if index == 0:
                if block in done:
                    continue
                path.append(block)
            targets = [target for target in after[block] if target in after]
            if index == len(targets):
                path.pop()
                done.add(block)
                continue
            stack.append((block, index + 1))
            target = targets[index]
            if target in path:
                loop = (*path[path.index(target) :], target)
                message = f"the loop {' → '.join(loop)} never rests: expected a block in it that takes time"
                return [Remark(target, "error", "restless-loop", message)]
            if target not in done:
                stack.append((target, 0))
    return []
