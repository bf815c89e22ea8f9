"""A mission as a Petri net: a block is a place, each of its outcomes a transition.

A Join has a place per block that leads to it and fires when all of them hold a token; any other block
with several incoming edges is a merge. End consumes its token and clears the net.
"""

import msgspec

from swarmware.mission.model import Mission


class Transition(msgspec.Struct, frozen=True):
    """Takes one token from each of its inputs and puts one on each of its outputs."""

    block: str
    outcome: str
    inputs: frozenset[str]
    outputs: tuple[str, ...]
    """Empty: the End."""

    @property
    def label(self) -> str:
        """How it is called in a counter-example."""
        return self.block if self.outcome == "ok" else f"{self.block}:{self.outcome}"


class Net(msgspec.Struct, frozen=True):
    """Places are block ids, for a Join `<source>→<join>`."""

    start: str
    transitions: tuple[Transition, ...]
    owner: dict[str, str]
    """Block of each place."""


def join_place(source: str, join: str) -> str:
    """Place of a Join for the branch that comes from `source`; its outcomes share it."""
    return f"{source}→{join}"


def build(mission: Mission) -> Net:
    """The net of a mission whose successors all exist."""
    joins = {block.id for block in mission.blocks.values() if block.type == "Join"}
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
        if not inputs:
            continue
        if block.type == "End":
            transitions.append(Transition(block.id, "ok", inputs, ()))
        elif block.type == "Fork":
            outputs = tuple(place_of(block.id, edge.target) for edge in block.edges)
            transitions.append(Transition(block.id, "ok", inputs, outputs))
        else:
            transitions += [
                Transition(block.id, edge.outcome, inputs, (place_of(block.id, edge.target),))
                for edge in block.edges
            ]
    return Net(mission.start, tuple(transitions), owner)
