"""Flight phases of a mission: in which states the vehicle is in the air, and which blocks move it."""

from collections.abc import Callable

from swarmware.mission import plausible
from swarmware.mission.catalogue import BlockName, End, Goto, Params, Waypoints
from swarmware.mission.finding import Remark, Severity
from swarmware.mission.model import MissionDefinition
from swarmware.mission.net import Bits, Firing, Marking
from swarmware.mission.outcome import SUCCESS, TIMED_OUT

Trace = Callable[[], tuple[str, ...]]
"""Returns the counter-example of the current state; called only for a remark."""

_ARMED = "vehicle/state.armed"

RULES = frozenset({"below-ground", "not-in-the-air"})
"""Rules that apply only to flying vehicles."""


def below_ground(mission: MissionDefinition) -> list[Remark]:
    """Remarks about heights below the ground."""
    return [
        Remark(
            block.id,
            "error",
            "below-ground",
            f"{block.id!r} flies at a height of {height_m:g} m: "
            "expected above 0, or no `z_m` to keep the height",
        )
        for block in mission.blocks.values()
        for height_m in _heights(block.params)
        if -plausible.DEPTH_M <= height_m <= 0
    ]


def _heights(params: Params) -> list[float]:
    """Heights to which a block moves the vehicle."""
    if isinstance(params, Goto):
        return [] if params.z_m is None else [params.z_m]
    return [point[2] for point in params.points_m if len(point) == 3] if isinstance(params, Waypoints) else []


class FlightPhases:
    """Adds two bits to each marking: the vehicle is in the air, and its motors are armed."""

    def __init__(self, mission: MissionDefinition, bits: Bits, *, flies: bool) -> None:
        self._mission = mission
        self._bits = bits
        self._air: Marking = 1 << len(bits.places) if flies else 0
        self._motions = sum(bits.of[block.id] for block in mission.blocks.values() if block.spec.motion)
        self._grounded = sum(
            bits.of[block.id] for block in mission.blocks.values() if block.spec.airborne and flies
        )
        self._found: dict[tuple[str, str], Remark] = {}
        takeoffs = [block.id for block in mission.blocks.values() if block.type == BlockName.TAKEOFF]
        # a mission that requires the motors to be on does not arm them
        required = any(_ARMED in condition.text for condition in mission.requires)
        self._takeoffs: Marking = 0 if required or not flies else sum(bits.of[name] for name in takeoffs)
        self._armed: Marking = 1 << (len(bits.places) + 1) if self._takeoffs else 0
        self._ready: Marking = 0
        """Takeoffs that begin with the motors on in some state."""
        self._unready: dict[str, tuple[str, ...]] = {}
        """Takeoffs that begin with the motors off in some state, and the way there."""

    def remarks(self) -> list[Remark]:
        """The remarks on all paths that were followed."""
        return [*self._found.values(), *(self._unarmed(*found) for found in self._unready.items())]

    def _unarmed(self, block: str, trace: tuple[str, ...]) -> Remark:
        sometimes = bool(self._ready & self._bits.of[block])
        severity: Severity = "warning" if sometimes else "error"
        how = "can begin" if sometimes else "begins"
        message = f"{block!r} {how} with the motors off, and fails: expected an Arm before it"
        return Remark(block, severity, "not-armed", message, trace)

    def after(self, step: Firing, marking: Marking) -> tuple[Marking, ...]:
        """The possible markings after a step: in the air or on the ground, armed or not."""
        kind = self._mission.blocks[step.block].type
        if self._armed and kind in {BlockName.ARM, BlockName.DISARM}:
            there = marking | self._armed if kind == BlockName.ARM else marking & ~self._armed
            if step.outcome == SUCCESS or there == marking:
                return (there,)
            # refused: it stays as it is; after a time-out either is possible
            return (marking, there) if step.outcome == TIMED_OUT else (marking,)
        if not self._air or kind not in {BlockName.TAKEOFF, BlockName.LAND}:
            return (marking,)
        there = marking | self._air if kind == BlockName.TAKEOFF else marking & ~self._air
        # after an error the vehicle may be in the air or on the ground
        return (there,) if step.outcome == SUCCESS or there == marking else (there, marking)

    def look(self, marking: Marking, trace: Trace) -> None:
        """Check the blocks that are active in a state of the mission."""
        rising = marking & self._takeoffs
        if rising and marking & self._armed:
            self._ready |= rising
        elif rising:
            for block in self._bits.blocks(rising):
                if block not in self._unready:
                    self._unready[block] = trace()
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
