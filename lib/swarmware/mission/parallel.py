"""Merges parallel branches of a Fork whose barriers all roles pass in the same way.

Barriers of parallel branches open in any order, so n of them have 2^n states. When each role has the branches
between one Fork and one Join, and they are alike, one of them represents all: a member leaves the Join when
all barriers have opened, and a member that ends before breaks the others, as it breaks the representative.
Source: Murata, Petri nets: properties, analysis and applications (1989), section VI: fusion of parallel
places and transitions, here over the nets of several members.
"""

from collections.abc import Mapping, Sequence

import msgspec

from swarmware.mission.catalogue import Barrier
from swarmware.mission.model import Block
from swarmware.mission.net import Net, Transition

Gates = Mapping[str, Block]
"""Barriers of a role by their place."""
_Shape = tuple[object, ...]
"""Two branches with equal shapes behave alike, apart from the ids of their barriers."""


class _ParallelBranch(msgspec.Struct, frozen=True):
    """A line of places from a Fork to a Join, with barriers in it."""

    places: tuple[str, ...]
    """All places, the last one belongs to the Join."""
    barriers: tuple[str, ...]
    """Ids of its barriers, in order."""
    shape: _Shape


def merge(nets: Sequence[Net], gates: Sequence[Gates]) -> list[Net]:
    """The nets of the roles, in which one of several branches that are alike in all roles stands for them."""
    found = [_branches(net, own) for net, own in zip(nets, gates, strict=True)]
    everywhere = {barriers: None for branches in found for barriers in branches}
    groups: dict[tuple[_Shape | None, ...], tuple[str, ...]] = {}
    spare: list[tuple[str, ...]] = []
    for barriers in everywhere:
        if any(
            barriers not in branches and _uses(own, barriers)
            for branches, own in zip(found, gates, strict=True)
        ):
            continue  # a role that has them in another place passes them in another order
        key = tuple(branches[barriers].shape if barriers in branches else None for branches in found)
        if groups.setdefault(key, barriers) != barriers:
            spare.append(barriers)
    return [
        _without(net, [branches[barriers] for barriers in spare if barriers in branches])
        for net, branches in zip(nets, found, strict=True)
    ]


def _uses(gates: Gates, barriers: tuple[str, ...]) -> bool:
    return any(_barrier(block).id in barriers for block in gates.values())


def _barrier(block: Block) -> Barrier:
    assert isinstance(block.params, Barrier)
    return block.params


def _branches(net: Net, gates: Gates) -> dict[tuple[str, ...], _ParallelBranch]:
    """Branches whose barriers this role has nowhere else, by the ids of the barriers."""
    uses: dict[str, int] = {}
    for block in gates.values():
        uses[_barrier(block).id] = uses.get(_barrier(block).id, 0) + 1
    lines = _BranchWalk(net, gates)
    found: dict[tuple[str, ...], _ParallelBranch] = {}
    heads = {place: None for t in net.transitions if len(t.outputs) > 1 for place in t.outputs}
    for head in heads:
        branch = lines.branch(head)
        # a barrier that the role has twice is visited in an order, which one branch cannot represent
        if branch is not None and all(uses[barrier] == 1 for barrier in branch.barriers):
            found[branch.barriers] = branch
    return found


class _BranchWalk:
    """Follows branches in a net."""

    def __init__(self, net: Net, gates: Gates) -> None:
        self._net = net
        self._gates = gates
        self._ends = net.ends()
        self._into: dict[str, list[int]] = {}
        self._from: dict[str, list[int]] = {}
        for number, transition in enumerate(net.transitions):
            for place in transition.inputs:
                self._from.setdefault(place, []).append(number)
            for place in transition.outputs:
                self._into.setdefault(place, []).append(number)

    def branch(self, head: str) -> _ParallelBranch | None:
        """The branch that begins with this place of a Fork, if it is a line with barriers to a Join."""
        place, before = head, self._into[head]
        if any(len(self._net.transitions[number].outputs) < 2 for number in before):
            return None
        places: list[str] = []
        barriers: list[str] = []
        shape: list[object] = [tuple(before)]
        while self._into[place] == before and place != self._net.start:
            places.append(place)
            after = [self._net.transitions[number] for number in self._from.get(place, ())]
            if len(after) == 1 and len(after[0].inputs) > 1:
                shape.append(self._from[place][0])
                return _ParallelBranch(tuple(places), tuple(barriers), tuple(shape)) if barriers else None
            following = {output for t in after for output in t.outputs} - self._ends
            if len(following) != 1 or any(t.inputs != {place} or len(t.outputs) > 1 for t in after):
                return None
            ways = frozenset((t.outcome.label, self._ends_with(t)) for t in after)
            if place in self._gates:
                block = self._gates[place]
                barrier = _barrier(block)
                barriers.append(barrier.id)
                shape.append((barrier.quorum, barrier.roles, block.timeout_s is not None, ways))
            elif place in self._net.instant or any(end for _, end in ways):
                shape.append((place in self._net.instant, frozenset(end for _, end in ways)))
            # pauses are ignored, as no result depends on their length
            before = [number for number in self._from[place] if self._net.transitions[number].outputs]
            before = [number for number in before if self._net.transitions[number].outputs[0] in following]
            place = next(iter(following))
        return None

    def _ends_with(self, transition: Transition) -> str:
        """Way in which the transition ends the mission, or "" if it does not."""
        if not transition.outputs:
            return "fails"
        return "ends" if transition.outputs[0] in self._ends else ""


def _without(net: Net, branches: list[_ParallelBranch]) -> Net:
    """The net without these branches."""
    gone = {place for branch in branches for place in branch.places}
    if not gone:
        return net  # most nets have no branches that are alike
    transitions = [
        msgspec.structs.replace(
            transition,
            inputs=transition.inputs - gone,
            outputs=tuple(place for place in transition.outputs if place not in gone),
        )
        for transition in net.transitions
        if transition.inputs - gone
    ]
    return msgspec.structs.replace(
        net,
        transitions=tuple(transitions),
        owner={place: block for place, block in net.owner.items() if place not in gone},
        instant=net.instant - gone,
    )
