"""Checks the soundness of a mission: every block is reachable, and an End is reachable from every state.

Explores all markings of the mission's net and finds dead blocks, deadlocks, branches that never join or
end, two tokens in one block, livelocks, and motions that an End cuts short.
"""

from collections import deque
from itertools import chain
from typing import Final

from swarmware.mission import flight, instants, plausible
from swarmware.mission.budget import QUICK_BYTES, Budget
from swarmware.mission.catalogue import BlockName, End
from swarmware.mission.finding import TOO_LARGE, Remark
from swarmware.mission.model import MissionDefinition
from swarmware.mission.net import PLACES_PER_BYTE, Bits, Firing, Marking, Net, build
from swarmware.mission.reduction import reduce

_STATE: Final = 800
"""Budget of a visited state, in bytes: dictionaries, queue and predecessor (480), and its time."""
_STEP: Final = 80
"""Budget of a step from one state to the next, in bytes, with its time."""
SHOWN_LIMIT: Final = 6
"""Maximum blocks that a message names as running at the same time."""

_MOTORS: Final = frozenset({BlockName.ARM, BlockName.DISARM})

Key = bytes
"""The marking as bytes, for dictionaries: integers whose bits are 61 apart have equal hashes (modulo 2**61 -
1)."""

STUCK_LIMIT: Final = 1_000
"""Maximum explained deadlocks: further ones add no information."""


def check(mission: MissionDefinition, budget: Budget | None = None, *, flies: bool = False) -> list[Remark]:
    """All findings about the soundness of a mission, with counter-examples.

    `flies`: an air vehicle may execute it.
    """
    budget = budget or Budget()
    found = [*instants.check(mission), *plausible.check(mission)]
    # only an air vehicle can be sent below the ground
    found += flight.below_ground(mission) if flies else []
    return [*found, *_states(mission, budget, flies=flies)]


def _states(mission: MissionDefinition, budget: Budget, *, flies: bool) -> list[Remark]:
    """Findings in any state: detected on the reduced net, explained on the unreduced one if that is small."""
    whole = build(mission)
    found = explore(mission, reduced(mission, whole, budget), budget, flies=flies)
    # a sound mission needs no explanation, which is the usual case
    if not found or budget.spent:
        return found
    part = Budget(QUICK_BYTES)
    explained = explore(mission, whole, part, flies=flies)
    # traces of the whole net name each block; a large one cannot be explored in time
    return found if part.spent else explained


def reduced(mission: MissionDefinition, net: Net, budget: Budget) -> Net:
    """A smaller net with the same findings."""

    def result(block: str) -> str:
        params = mission.blocks[block].params
        return params.result if isinstance(params, End) else ""

    blocks = mission.blocks.values()
    rises = any(block.type == BlockName.TAKEOFF for block in blocks)
    kept = [block.id for block in blocks if block.spec.motion or (rises and block.type in _MOTORS)]
    return reduce(net, kept, budget, result)


def explore(mission: MissionDefinition, net: Net, budget: Budget, *, flies: bool) -> list[Remark]:
    """Findings in any state of this net."""
    return _Exploration(mission, Bits(net), budget, flies=flies).remarks()


class _Exploration:
    """Explores the markings breadth first, so counter-examples are the shortest ones."""

    def __init__(self, mission: MissionDefinition, bits: Bits, budget: Budget, *, flies: bool) -> None:
        self._mission = mission
        self._bits = bits
        self._budget = budget
        self._size = len(bits.places) // PLACES_PER_BYTE
        self._width = (len(bits.places) + 1) // 8 + 1  # with the two bits of the flight
        self._flight = flight.FlightPhases(mission, bits, flies=flies)
        self._motions = sum(bits.of[block.id] for block in mission.blocks.values() if block.spec.motion)
        first = self._key(bits.start)
        self._came: dict[Key, tuple[Key, Key | None, tuple[str, ...]]] = {first: (first, None, ())}
        """Visited markings in their order, each with its predecessor and the step from there."""
        self._after: dict[Key, list[Key]] = {}
        self._ends: set[Key] = set()
        self._fired: set[str] = set()
        """Blocks that a token has left in some state."""
        self._unsafe: dict[str, Remark] = {}
        self._stuck: list[Key] = []
        self._cut: dict[str, Remark] = {}
        self._cutters: dict[str, str] = {}
        """Blocks with a token when an End came, and the End."""
        self._cut_places: Marking = 0
        self._widest: Marking = 0
        """The state with the most tokens."""

    def remarks(self) -> list[Remark]:
        """Explores all markings, then derives the findings."""
        complete = self._explore()
        found = [*self._unsafe.values(), *self._deadlocks()]
        if not complete:
            blocks = self._bits.blocks(self._widest)
            shown = ", ".join(blocks[:SHOWN_LIMIT]) + (", …" if len(blocks) > SHOWN_LIMIT else "")
            several = f"; {len(blocks)} blocks can run at the same time ({shown})" if len(blocks) > 1 else ""
            message = (
                f"too large to check: more than {len(self._came)} states{several}; "
                "expected fewer blocks that run at the same time"
            )
            found += self._flight.remarks()
            return [*found, Remark(self._mission.start, "unknown", TOO_LARGE, message)]
        # with two tokens in a block the markings are incomplete, and further findings would be false
        if not self._unsafe:
            found += self._dead()
            found += self._endless()
        return [*found, *self._flight.remarks(), *self._cut.values()]

    def _explore(self) -> bool:
        queue = deque(self._came)
        while queue:
            if self._budget.spent:
                return False
            key = queue.popleft()
            marking = int.from_bytes(key, "little")
            # the widest state is the reason that a too large check names
            if marking.bit_count() > self._widest.bit_count():
                self._widest = marking
            after: list[Key] = []
            self._flight.look(marking, lambda key=key: self._trace(key))  # type: ignore[misc]  # the default binds the value now
            steps = self._bits.steps(marking)
            # Only in a state of rest do blocks run; a token passes through instant ones.
            if self._bits.rests(steps):
                self._fired |= self._bits.within(marking)
            for step in steps:
                self._fire(marking, key, step, after, queue)
            self._after[key] = after
            if not steps:
                self._stuck.append(key)
        return True

    def _fire(self, marking: Marking, key: Key, step: Firing, after: list[Key], queue: deque[Key]) -> None:
        self._fired |= step.passes
        if not step.outputs:
            self._ends.add(key)
            self._flight.end(step.block, marking, lambda: (*self._trace(key), *step.labels))
            self._cut_short(marking, key, step)
            cut = marking & ~step.inputs & ~self._cut_places
            # a block that never completes is explained by the End that came first
            if cut:
                self._cut_places |= cut
                self._cutters |= dict.fromkeys(self._bits.blocks(cut), step.block)
            return
        rest = marking & ~step.inputs
        # a second token in an End changes nothing: the first one clears the net
        twice = (rest & step.outputs | step.twice) & ~self._bits.ends
        if twice:
            self._two_tokens(key, step, twice)
            return
        for marking_after in self._flight.after(step, rest | step.outputs):
            result = self._key(marking_after)
            self._budget.pay(_STEP + self._size)
            came = self._came.get(result)
            if came is None:
                self._budget.pay(_STATE + self._size)
                came = self._came[result] = (result, key, step.labels)
                queue.append(result)
            after.append(came[0])

    def _key(self, marking: Marking) -> Key:
        return marking.to_bytes(self._width, "little")

    def _trace(self, key: Key) -> tuple[str, ...]:
        steps: list[tuple[str, ...]] = []
        _, before, labels = self._came[key]
        while before is not None:
            steps.append(labels)
            _, before, labels = self._came[before]
        return tuple(chain.from_iterable(reversed(steps)))

    def _two_tokens(self, key: Key, step: Firing, twice: Marking) -> None:
        block = self._bits.blocks(twice)[0]
        if block not in self._unsafe:
            trace = (*self._trace(key), *step.labels)
            message = f"{block!r} is entered again while it still runs: expected a Join before it"
            self._unsafe[block] = Remark(block, "error", "two-tokens", message, trace)

    def _cut_short(self, marking: Marking, key: Key, end: Firing) -> None:
        for block in self._bits.blocks(marking & self._motions & ~end.inputs):
            message = f"the motion {block!r} can be cut short by the End {end.block!r}"
            trace = (*self._trace(key), *end.labels)
            self._cut[block] = Remark(block, "warning", "cut-short", message, trace)
            self._motions &= ~self._bits.of[block]  # one finding is enough

    def _deadlocks(self) -> list[Remark]:
        found: dict[str, Remark] = {}
        for key in self._stuck[:STUCK_LIMIT]:
            marking = int.from_bytes(key, "little")
            for block in self._bits.blocks(marking):
                if block in found:
                    continue
                missing = sorted(
                    place.partition("→")[0]
                    for index, place in enumerate(self._bits.places)
                    if self._bits.owner[place] == block and not marking >> index & 1
                )
                message = (
                    f"deadlock: the Join {block!r} waits for ever for {', '.join(map(repr, missing))}; "
                    "expected every branch to arrive"
                    if missing
                    else f"{block!r} has no successor"
                )
                found[block] = Remark(block, "error", "deadlock", message, self._trace(key))
                break
        return list(found.values())

    def _dead(self) -> list[Remark]:
        everywhere = 0
        for key in self._came:
            everywhere |= int.from_bytes(key, "little")
        reached = self._fired.union(self._bits.blocks(everywhere))
        found: list[Remark] = []
        for block in self._mission.blocks.values():
            if block.id not in reached:
                message = (
                    f"{block.id!r} can never be reached: expected a block that leads to it, and no End that "
                    "always comes before"
                )
                found.append(Remark(block.id, "error", "dead-block", message))
            # after a deadlock later blocks are unreachable for that reason alone
            elif block.id in self._fired or self._stuck:
                continue
            elif block.type != BlockName.JOIN and block.id in self._cutters:
                message = (
                    f"{block.id!r} never completes: the End {self._cutters[block.id]!r} comes at the same "
                    "instant and ends the mission; expected a Join before that End"
                )
                self._cut.setdefault(block.id, Remark(block.id, "warning", "cut-short", message))
            else:
                message = f"{block.id!r} can never be left: not all its branches can arrive together"
                found.append(Remark(block.id, "error", "dead-block", message))
        return found

    def _endless(self) -> list[Remark]:
        before: dict[Key, list[Key]] = {}
        for key, results in self._after.items():
            for result in results:
                before.setdefault(result, []).append(key)
        can_end = set(self._ends) | set(self._stuck)  # deadlocked blocks have a finding of their own
        queue = deque(can_end)
        while queue:
            for key in before.get(queue.popleft(), ()):
                if key not in can_end:
                    can_end.add(key)
                    queue.append(key)
        for key in self._came:
            if key not in can_end:
                blocks = self._bits.blocks(int.from_bytes(key, "little"))
                message = (
                    f"from {', '.join(map(repr, blocks))} no End can be reached: "
                    "expected every branch to join or end"
                )
                return [Remark(blocks[0], "error", "never-ends", message, self._trace(key))]
        return []
