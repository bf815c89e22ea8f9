"""A mission as a Petri net: a block is a place, each of its outcomes a transition.

A Join has a place per block that leads to it and fires when all of them hold a token; any other block
with several incoming edges is a merge. End consumes its token and clears the net.
"""

from collections.abc import Iterator
from enum import Enum
from typing import Final

import msgspec

from swarmware.mission.catalogue import BlockName
from swarmware.mission.model import Block, MissionDefinition
from swarmware.mission.outcome import FAILS, SUCCESS, TIMED_OUT, BlockOutcome, OutcomeKind

Marking = int
"""Bit set of the places with a token: a marking of thousands of places takes a few hundred bytes."""

PLACES_PER_BYTE: Final = 7
"""Places per byte of a marking in memory: 30 bits of an integer take 4 bytes."""


class Transition(msgspec.Struct, frozen=True):
    """Takes one token from each of its inputs and puts one on each of its outputs."""

    block: str
    outcome: BlockOutcome
    inputs: frozenset[str]
    outputs: tuple[str, ...]
    """Output places, or () for the transition of an End."""
    path: tuple[str, ...] = ()
    """Labels of the transitions that a reduction has merged into this one, in order."""
    passes: frozenset[str] = frozenset()
    """Blocks that a token passes in the merged transitions."""

    @property
    def label(self) -> str:
        """Text of the transition in a counter-example."""
        return self.block if self.outcome == SUCCESS else f"{self.block}:{self.outcome.label}"


class Net(msgspec.Struct, frozen=True):
    """A Petri net; a place is named by its block id, a place of a Join `<source>→<join>`."""

    start: str
    transitions: tuple[Transition, ...]
    owner: dict[str, str]
    """Block of each place."""
    instant: frozenset[str]
    """Places that a token leaves in no time, including the places of Ends."""
    within: dict[str, frozenset[str]] = {}
    """Further blocks that a token in this place passes, after all instantaneous transitions."""

    def ends(self) -> frozenset[str]:
        """Places of the Ends."""
        ending = {place for t in self.transitions if not t.outputs for place in t.inputs}
        going = {place for t in self.transitions if t.outputs for place in t.inputs}
        return frozenset((ending - going) & self.instant)


def join_place(source: str, join: str) -> str:
    """Place of a Join for the branch from `source`; all outcomes of `source` share it."""
    return f"{source}→{join}"


class Faults(Enum):
    """Errors and time-outs of blocks that a net has."""

    NONE = "none"
    """Every block succeeds; only barriers may break."""
    HANDLED = "handled"
    """Only errors and time-outs that have a successor."""
    ALL = "all"
    """Also errors and time-outs without a successor, which end the mission."""


_FAULTLESS: Final = frozenset({OutcomeKind.OK, OutcomeKind.CASE, OutcomeKind.TRUE, OutcomeKind.FALSE})


def build(mission: MissionDefinition, faults: Faults = Faults.HANDLED) -> Net:
    """The net of a mission whose successors all exist."""
    joins = {block.id for block in mission.blocks.values() if block.type == BlockName.JOIN}
    owner = {block_id: block_id for block_id in mission.blocks if block_id not in joins}
    places: dict[str, set[str]] = {join: set() for join in joins}
    for block in mission.blocks.values():
        for edge in block.edges:
            if edge.target in joins:
                place = join_place(block.id, edge.target)
                places[edge.target].add(place)
                owner[place] = edge.target

    def place_of(source: str, target: str) -> str:
        return join_place(source, target) if target in joins else target

    transitions: list[Transition] = []
    for block in mission.blocks.values():
        inputs = frozenset(places[block.id] if block.id in joins else {block.id})
        # a Join that nothing leads to never fires
        if not inputs:
            continue
        if block.type == BlockName.END:
            transitions.append(Transition(block.id, SUCCESS, inputs, ()))
        elif block.type == BlockName.FORK:
            outputs = tuple(place_of(block.id, edge.target) for edge in block.edges)
            transitions.append(Transition(block.id, SUCCESS, inputs, outputs))
        else:
            transitions += [
                Transition(block.id, edge.outcome, inputs, (place_of(block.id, edge.target),))
                for edge in block.edges
                if faults is not Faults.NONE
                or edge.outcome.kind in _FAULTLESS
                # a barrier may break without a fault of this member
                or block.type == BlockName.BARRIER
            ]
            if faults is Faults.ALL and _can_fail(block):
                transitions.append(Transition(block.id, FAILS, inputs, ()))
    instant = frozenset(place for place, block in owner.items() if mission.blocks[block].spec.instant)
    return Net(mission.start, tuple(transitions), owner, instant)


def _can_fail(block: Block) -> bool:
    ways = [BlockOutcome(OutcomeKind.ERROR, kind) for kind in block.spec.errors]
    if block.timeout_s is not None and block.spec.can_time_out:
        ways.append(TIMED_OUT)
    return any(block.successor(way) is None for way in ways)


class Firing(msgspec.Struct, frozen=True):
    """A transition over markings."""

    block: str
    outcome: BlockOutcome
    labels: tuple[str, ...]
    inputs: Marking
    outputs: Marking
    """Marking of the output places, or 0 for the transition of an End."""
    twice: Marking
    """Output places that it marks twice."""
    passes: frozenset[str]
    """Blocks that a token passes in this transition."""


class Bits:
    """A net over markings."""

    def __init__(self, net: Net) -> None:
        self.owner = net.owner
        self.places = list(net.owner)
        self._within = net.within
        bit = {place: 1 << index for index, place in enumerate(self.places)}
        self.start = bit[net.start]
        # a transition is tried only where its first input is marked
        self._by_bit: dict[Marking, list[Firing]] = {}
        self._instant = sum(bit[place] for place in net.instant)
        self.ends = sum(bit[place] for place in net.ends())
        """Places of the Ends."""
        for transition in net.transitions:
            inputs = sum(bit[place] for place in transition.inputs)
            outputs = twice = 0
            for place in transition.outputs:
                # a second token in a place is a finding, which a bit cannot hold
                twice |= outputs & bit[place]
                outputs |= bit[place]
            labels = (transition.label, *transition.path)
            passes = transition.passes | {transition.block}
            step = Firing(transition.block, transition.outcome, labels, inputs, outputs, twice, passes)
            # the lowest input stands for all, so each transition is tried once
            self._by_bit.setdefault(inputs & -inputs, []).append(step)
        self.of: dict[str, Marking] = {}
        """Places of each block."""
        for place, block in net.owner.items():
            self.of[block] = self.of.get(block, 0) | bit[place]

    def steps(self, marking: Marking) -> list[Firing]:
        """Enabled transitions; instantaneous ones take precedence, as in the player.

        Among these an End comes last, so the findings do not depend on the order of the blocks in the file.
        """
        for instant in (self._instant & ~self.ends, self.ends):
            rest = marking & instant
            while rest:
                first = rest & -rest
                if found := self._enabled(first, marking):
                    return found
                rest ^= first
        every: list[Firing] = []
        rest = marking & ~self._instant
        while rest:
            first = rest & -rest
            every += self._enabled(first, marking)
            rest ^= first
        return every

    def rests(self, steps: list[Firing]) -> bool:
        """Whether all enabled transitions take time."""
        return not any(step.inputs & self._instant for step in steps)

    def blocks(self, marking: Marking) -> list[str]:
        """Blocks with a token, sorted by name."""
        return sorted({self.owner[place] for place in self._marked(marking)})

    def within(self, marking: Marking) -> set[str]:
        """Further blocks that these tokens pass."""
        return {block for place in self._marked(marking) for block in self._within.get(place, ())}

    def _marked(self, marking: Marking) -> Iterator[str]:
        marking &= (1 << len(self.places)) - 1
        while marking:
            yield self.places[(marking & -marking).bit_length() - 1]
            marking &= marking - 1

    def _enabled(self, first: Marking, marking: Marking) -> list[Firing]:
        """Transitions with this first input that are enabled: all places of a Join must have a token."""
        return [step for step in self._by_bit.get(first, ()) if step.inputs & ~marking == 0]
