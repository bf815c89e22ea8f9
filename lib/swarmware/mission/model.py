"""A loaded mission: blocks with typed parameters, and their successors."""

from functools import cached_property
from typing import Final

import msgspec

from swarmware.footprint.blake2b import blake2b
from swarmware.mission.catalogue import BlockName, BlockType, Params, Resume
from swarmware.mission.condition import ConditionExpression
from swarmware.mission.outcome import ANY_ERROR, BARRIER_BROKEN, TIMED_OUT, BlockOutcome, OutcomeKind

STEPS_LIMIT: Final = 1_000
"""Maximum blocks that the player enters in one event; the check refuses a mission that needs more."""

PRIORITIES: Final = (0, 99)
"""Lowest and highest priority of a mission; built-in missions precede all of them."""
TOLERANCE_LIMIT_S: Final = 86_400.0
"""Longest tolerance of a suspended member: a day."""

ON_FAILURE: Final = ("land", "hold", "return")
"""Built-in missions that may follow a failed mission."""

CONTINUE: Final = "continue"
LINK_LOSS: Final = (CONTINUE, *ON_FAILURE)
"""Actions of a vehicle without a link to any ground station: continue, or a built-in mission."""


class Edge(msgspec.Struct, frozen=True):
    """The successor of a block for one outcome."""

    outcome: BlockOutcome
    target: str
    """Id of the block that follows."""
    pointer: str
    """JSON pointer of its place in the file."""
    condition: ConditionExpression | None = None
    """Condition of a Decision's case."""


class Block(msgspec.Struct, frozen=True):
    """One block of a mission."""

    id: str
    spec: BlockType
    params: Params
    edges: tuple[Edge, ...]
    timeout_s: float | None
    """Time-out of the block, or None without one."""
    pointer: str
    resume: Resume = "restart"
    """Way in which the block continues after its mission was suspended."""

    @property
    def type(self) -> str:
        """Name of the block's type."""
        return self.spec.name

    def successor(self, outcome: BlockOutcome) -> str | None:
        """Successor for this outcome, else the general error successor, else None."""
        targets = {edge.outcome: edge.target for edge in self.edges}
        # `next` is for success alone: an error without a successor fails the mission
        if outcome in targets or outcome.kind is not OutcomeKind.ERROR:
            return targets.get(outcome)
        return targets.get(ANY_ERROR)

    def follower(self, outcome: BlockOutcome) -> str | None:
        """Block that follows; a broken barrier without an edge of its own counts as an early time-out."""
        if outcome == BARRIER_BROKEN and not any(edge.outcome == outcome for edge in self.edges):
            return self.successor(TIMED_OUT) or self.successor(outcome)
        return self.successor(outcome)


class MissionDefinition(msgspec.Struct, frozen=True, dict=True):
    """A mission in which all parameters have values."""

    file: str
    blocks: dict[str, Block]
    start: str
    on_failure: str = "land"
    on_link_loss: str = ""
    """One of LINK_LOSS, or "" for the setting of the platform."""
    requires: tuple[ConditionExpression, ...] = ()
    """Conditions that are checked before the start and every second."""
    priority: int = 0
    """A mission of higher priority suspends one of lower priority."""
    tolerance_s: float = 30.0
    """Time for which the others wait at a barrier for a member whose part is suspended."""

    @cached_property
    def resources(self) -> frozenset[str]:
        """Paths of the resources in the conditions of the mission."""
        # cached: an order is accepted while other processes wait for the processor
        conditions = [*self.requires]
        for block in self.blocks.values():
            conditions += [edge.condition for edge in block.edges if edge.condition]
        return frozenset(path for condition in conditions for path in condition.resources())

    @cached_property
    def barriers(self) -> tuple[Block, ...]:
        """The blocks of type Barrier."""
        return tuple(block for block in self.blocks.values() if block.type == BlockName.BARRIER)


def content_hash(*parts: str) -> str:
    """BLAKE2b-128 of the texts, each with its length, hex."""
    state = blake2b(digest_size=16)
    for part in parts:
        data = part.encode()
        # without lengths, ("ab", "c") and ("a", "bc") would have the same hash
        state.update(len(data).to_bytes(8, "little"))
        state.update(data)
    return state.hexdigest()
