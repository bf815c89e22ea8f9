"""Where the vehicle is in each state of a mission, on the ground or in the air, and which blocks move it."""

from collections.abc import Callable

from swarmware.mission.catalogue import End, Goto
from swarmware.mission.finding import Remark, Severity
from swarmware.mission.model import OK, MissionDefinition
from swarmware.mission.net import Bits, Firing, Marking

Trace = Callable[[], tuple[str, ...]]
"""The way to the state that is looked at; asked for only when there is something to say."""

RULES = frozenset({"below-ground", "not-in-the-air"})
"""What is wrong only for a vehicle that flies."""
_NEED_AIR = frozenset({"Goto", "Formation"})


def below_ground(mission: MissionDefinition) -> list[Remark]:
    """Heights that lead a flying vehicle into the ground."""
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
    """Follows one more bit in each marking: set while the vehicle is in the air."""

    def __init__(self, mission: MissionDefinition, bits: Bits, *, flies: bool) -> None:
        self._mission = mission
        self._bits = bits
        self._air: Marking = 1 << len(bits.places) if flies else 0
        self._motions = sum(bits.of[block.id] for block in mission.blocks.values() if block.spec.motion)
        self._grounded = sum(
            bits.of[block.id] for block in mission.blocks.values() if block.type in _NEED_AIR and flies
        )
        self._found: dict[tuple[str, str], Remark] = {}

    def remarks(self) -> list[Remark]:
        """The remarks on all paths that were followed."""
        return list(self._found.values())

    def after(self, step: Firing, marking: Marking) -> tuple[Marking, ...]:
        """The marking after a step, where the vehicle may be then."""
        kind = self._mission.blocks[step.block].type
        if not self._air or kind not in {"Takeoff", "Land"}:
            return (marking,)
        there = marking | self._air if kind == "Takeoff" else marking & ~self._air
        # one that failed may have left the ground, or touched it, or not
        return (there,) if step.outcome == OK or there == marking else (there, marking)

    def look(self, marking: Marking, trace: Trace) -> None:
        """A state of the mission."""
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
        """The mission ends here; one that fails is followed by what brings the vehicle down."""
        params = self._mission.blocks[block].params
        if marking & self._air and isinstance(params, End) and params.result == "done":
            message = f"the mission can end at {block!r} in the air: expected a Land before it"
            self._say(block, "warning", "ends-in-the-air", message, trace)

    def _say(self, block: str, severity: Severity, rule: str, message: str, trace: Trace) -> None:
        if (block, rule) not in self._found:
            self._found[block, rule] = Remark(block, severity, rule, message, trace())
