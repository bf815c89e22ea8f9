"""Flight phases of a mission: in which states the vehicle is in the air, and which blocks move it."""

from collections.abc import Callable

from swarmware.mission.catalogue import BlockName, End, Goto
from swarmware.mission.finding import Remark, Severity
from swarmware.mission.model import MissionDefinition
from swarmware.mission.net import Bits, Firing, Marking
from swarmware.mission.outcome import SUCCESS

Trace = Callable[[], tuple[str, ...]]
"""Returns the counter-example of the current state; called only for a remark."""

RULES = frozenset({"below-ground", "not-in-the-air"})
"""Rules that apply only to flying vehicles."""


def below_ground(mission: MissionDefinition) -> list[Remark]:
    """Remarks about heights below the ground."""
    return [
        Remark(
            block.id,
            "error",
            "below-ground",
            f"{block.id!r} flies at a height of {block.params.z_m:g} m: "
            "expected above 0, or no `z_m` to keep the height",
        )
        for block in mission.blocks.values()
        if isinstance(block.params, Goto) and block.params.z_m is not None and block.params.z_m <= 0
    ]


class FlightPhases:
    """Adds a bit to each marking that is set while the vehicle is in the air."""

    def __init__(self, mission: MissionDefinition, bits: Bits, *, flies: bool) -> None:
        self._mission = mission
        self._bits = bits
        self._air: Marking = 1 << len(bits.places) if flies else 0
        self._motions = sum(bits.of[block.id] for block in mission.blocks.values() if block.spec.motion)
        self._grounded = sum(
            bits.of[block.id] for block in mission.blocks.values() if block.spec.airborne and flies
        )
        self._found: dict[tuple[str, str], Remark] = {}

    def remarks(self) -> list[Remark]:
        """The remarks on all paths that were followed."""
        return list(self._found.values())

    def after(self, step: Firing, marking: Marking) -> tuple[Marking, ...]:
        """The possible markings after a step, in the air or on the ground."""
        kind = self._mission.blocks[step.block].type
        if not self._air or kind not in {BlockName.TAKEOFF, BlockName.LAND}:
            return (marking,)
        there = marking | self._air if kind == BlockName.TAKEOFF else marking & ~self._air
        # after an error the vehicle may be in the air or on the ground
        return (there,) if step.outcome == SUCCESS or there == marking else (there, marking)

    def look(self, marking: Marking, trace: Trace) -> None:
        """Check the blocks that are active in a state of the mission."""
        moving = marking & self._motions
        if moving.bit_count() > 1:
            first, second, *_ = self._bits.blocks(moving)
            message = f"{first!r} and {second!r} can move the vehicle at once: expected one after the other"
            self._say(first, "error", "two-motions", message, trace)
        if not marking & self._air and marking & self._grounded:
            for block in self._bits.blocks(marking & self._grounded):
                message = f"{block!r} can begin before the take-off: expected a Takeoff before it"
                self._say(block, "error", "not-in-the-air", message, trace)

    def end(self, block: str, marking: Marking, trace: Trace) -> None:
        """Check an End of the mission; a failed one is followed by a built-in mission that lands."""
        params = self._mission.blocks[block].params
        if marking & self._air and isinstance(params, End) and params.result == "done":
            message = f"the mission can end at {block!r} in the air: expected a Land before it"
            self._say(block, "warning", "ends-in-the-air", message, trace)

    def _say(self, block: str, severity: Severity, rule: str, message: str, trace: Trace) -> None:
        if (block, rule) not in self._found:
            self._found[block, rule] = Remark(block, severity, rule, message, trace())
