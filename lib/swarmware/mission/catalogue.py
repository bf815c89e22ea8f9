"""The block types of the language: purpose, parameters and outcomes of each.

One table; the loader, the checks, the JSON Schema, the documentation and the player derive from it.
"""

from enum import StrEnum
from typing import Annotated, Final, Literal

import msgspec

from swarmware.errors import InvalidInput, MissionError
from swarmware.mission.resource_params import (
    ModuleService,
    Request,
    SetResource,
    UserBreakpoint,
    WaitForResource,
    check_own_fields,
)
from swarmware.mission.resource_params import Params as Params  # noqa: PLC0414 - packages take it from here
from swarmware.model.names import Pattern
from swarmware.model.platform_kind import VEHICLES, PlatformKind

Points = tuple[tuple[float, ...], ...]
"""Positions in the map frame, metres."""

Positive = Annotated[float, msgspec.Meta(gt=0, le=86_400)]
Speed = Annotated[float, msgspec.Meta(gt=0, le=30)]
Metres = Annotated[float, msgspec.Meta(ge=-100_000, le=100_000)]
Altitude = Annotated[float, msgspec.Meta(gt=0, le=1_000)]
Distance = Annotated[float, msgspec.Meta(gt=0, le=1_000)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]


class Nothing(Params, frozen=True):
    """The block takes no parameters."""


class End(Params, frozen=True):
    """End the mission with a result."""

    result: Literal["done", "failed"] = "done"
    """`failed`: the mission ended safely, but did not reach its goal; `on_failure` follows."""


class DecisionRandom(Params, frozen=True):
    """Take one of two successors at random."""

    chance_for_true: Ratio
    """Probability of the first successor."""


class Barrier(Params, frozen=True):
    """Wait until all participants have arrived."""

    id: Annotated[str, msgspec.Meta(min_length=1, max_length=64, pattern="^[^@]")]
    """Identity of the barrier in the missions of all members; ids of the system begin with @."""
    quorum: Literal["all"] | Annotated[int, msgspec.Meta(ge=1, le=1_000)] = "all"
    """Number of members that open it: all that are present, or a number."""
    roles: tuple[Name, ...] = ()
    """Roles that participate; without any, all do."""


class Wait(Params, frozen=True):
    """Pause for a time; exactly one of the two units is given."""

    ms: Annotated[float, msgspec.Meta(ge=0, le=86_400_000)] | msgspec.UnsetType = msgspec.UNSET
    """Length of the pause in milliseconds."""
    s: Annotated[float, msgspec.Meta(ge=0, le=86_400)] | msgspec.UnsetType = msgspec.UNSET
    """Length of the pause in seconds."""

    def __post_init__(self) -> None:
        """Check that exactly one unit is given."""
        if (self.ms is msgspec.UNSET) == (self.s is msgspec.UNSET):
            raise InvalidInput("expected exactly one of `ms` and `s`")

    @property
    def duration_s(self) -> float:
        """Length of the pause, in seconds."""
        if not isinstance(self.ms, msgspec.UnsetType):
            return self.ms / 1000
        return 0.0 if isinstance(self.s, msgspec.UnsetType) else self.s


class Takeoff(Params, frozen=True):
    """Climb straight up to an altitude."""

    altitude_m: Altitude
    """Height above the map's origin."""
    speed_m_s: Speed = 1.5
    """Speed of the climb."""


class Goto(Params, frozen=True):
    """Move to one position."""

    x_m: Metres
    """Position east of the map's origin."""
    y_m: Metres
    """Position north of the map's origin."""
    z_m: Metres | None = None
    """Height above the map's origin; without it a flying vehicle keeps its height."""
    yaw_rad: Annotated[float, msgspec.Meta(ge=-6.3, le=6.3)] | None = None
    """Heading at the end, from east to north; without it any heading."""
    speed_m_s: Speed = 1.5
    """Speed on the way."""


class Waypoints(Params, frozen=True):
    """Move to several positions, one after the other."""

    points_m: Annotated[tuple[tuple[Metres, ...], ...], msgspec.Meta(min_length=1, max_length=1_000)]
    """Positions [x, y], or [x, y, z] with a height; without a height a flying vehicle keeps its height."""
    speed_m_s: Speed = 1.5
    """Speed on the way."""
    loiter_s: Annotated[float, msgspec.Meta(ge=0, le=3_600)] = 0.0
    """Time that the vehicle stays at each position."""

    def __post_init__(self) -> None:
        """Check that each position has two or three coordinates."""
        if any(len(point) not in {2, 3} for point in self.points_m):
            raise InvalidInput("points_m: expected positions [x, y] or [x, y, z] in metres")

    @property
    def lasts_s(self) -> float:
        """Time of all stays."""
        return self.loiter_s * len(self.points_m)


class Return(Params, frozen=True):
    """Move back to the place of arming."""

    speed_m_s: Speed = 2.0
    """Speed on the way."""


class Formation(Params, frozen=True):
    """Keep a slot in a moving formation."""

    leader: Name
    """Platform of the leader; in the leader's own mission its own name."""
    shape: Literal["wedge", "line", "column"] = "wedge"
    """Arrangement of the slots."""
    slot: Annotated[int, msgspec.Meta(ge=0, le=1_000)] = 0
    """Place in the shape: 0 is its head, then left and right in turn."""
    spacing_m: Distance = 4.0
    """Distance of neighbouring slots, along and across."""
    offset_m: Annotated[tuple[float, ...], msgspec.Meta(min_length=3, max_length=3)] = (0.0, 0.0, 0.0)
    """Position of the shape's head relative to the leader: forward, left, up."""
    course: Points = ()
    """Waypoints of the leader, x and y."""
    advance: bool = False
    """Move along the course; without it the members move into their slots and keep them."""
    speed_m_s: Speed = 1.5
    """Speed of the leader along the course, and of a member on the way into its slot."""
    tolerance_m: Distance = 1.0
    """Formation error below which the member is in its slot."""
    settle_s: Annotated[float, msgspec.Meta(ge=0, le=60)] = 1.0
    """Time for which the error must stay below."""

    def __post_init__(self) -> None:
        """Check that waypoints are pairs, and that a formation that advances has some."""
        if any(len(point) != 2 for point in self.course):
            raise InvalidInput("course: expected pairs [x, y] in metres")
        if self.advance and not self.course:
            raise InvalidInput("advance without a course: expected at least one waypoint in `course`")


class Land(Params, frozen=True):
    """Land the vehicle where it is."""

    speed_m_s: Speed = 1.0
    """Speed of the descent."""
    blind: bool = False
    """Whether to descend at touch-down speed by the height alone, wherever the wind carries the vehicle."""


class Hold(Params, frozen=True):
    """Stay at the present position."""

    s: Annotated[float, msgspec.Meta(ge=0, le=86_400)] = 0.0
    """Time to hold, or 0 to end as soon as the vehicle is at rest, where it then stays."""

    @property
    def lasts_s(self) -> float:
        """The time for which the block holds."""
        return self.s


class WaitForSensor(Params, frozen=True):
    """Wait until a sensor delivers values."""

    sensor: Annotated[str, msgspec.Meta(min_length=1, max_length=200)] = "sensor/**"
    """Path of the sensor, or a pattern of several, of which one suffices: `sensor/gnss`, `sensor/*`."""
    measures: Annotated[str, msgspec.Meta(max_length=64)] = ""
    """Measured quantity: a type (`Barometer`) or a field (`temperature_degc`); "" accepts any."""
    until: Annotated[str, msgspec.Meta(max_length=500)] = ""
    """Condition on the fields of its value: `satellites >= 6`; "" accepts any fresh value."""

    def __post_init__(self) -> None:
        """Check the pattern and the condition."""
        if self.sensor.startswith("/"):
            raise InvalidInput(f"sensor {self.sensor!r}: expected one of this platform, such as sensor/gnss")
        Pattern(self.sensor)
        check_own_fields(self.until, "until", "the sensor")


Resume = Literal["restart", "continue", "skip", "abort"]
"""How a block continues when its mission was suspended: from its beginning, where it was, as if it had
completed, or with the error `preempted`."""


class BlockName(StrEnum):
    """Names of the built-in block types; packages add further ones."""

    START = "Start"
    END = "End"
    FORK = "Fork"
    JOIN = "Join"
    DECISION = "Decision"
    DECISION_RANDOM = "DecisionRandom"
    BARRIER = "Barrier"
    WAIT = "Wait"
    ARM = "Arm"
    DISARM = "Disarm"
    TAKEOFF = "Takeoff"
    GOTO = "Goto"
    WAYPOINTS = "Waypoints"
    RETURN = "Return"
    FORMATION = "Formation"
    LAND = "Land"
    HOLD = "Hold"
    WAIT_FOR_SENSOR = "WaitForSensor"
    WAIT_FOR_RESOURCE = "WaitForResource"
    REQUEST = "Request"
    SET_RESOURCE = "SetResource"
    START_MODULE = "StartModule"
    STOP_MODULE = "StopModule"
    USER_BREAKPOINT = "UserBreakpoint"


class BlockType(msgspec.Struct, frozen=True):
    """Definition of one block type."""

    name: str
    purpose: str
    """Purpose of the block, one sentence."""
    params: type[Params] = Nothing
    control: bool = False
    """True if the player executes it, otherwise a plug-in."""
    timeout_s: float | None = None
    """Default time-out, or None without one."""
    kinds: tuple[PlatformKind, ...] = ()
    """Kinds of platform that can execute it; () means all."""
    errors: tuple[str, ...] = ()
    """Kinds of error with which it may end."""
    motion: bool = False
    """True if it moves the vehicle; a cancelled motion commands hold."""
    airborne: bool = False
    """A vehicle that flies must be in the air when it begins."""
    instant: bool = False
    """True if it takes no time; a loop of only such blocks is a livelock."""
    aliases: tuple[tuple[str, str], ...] = ()
    """Alternative spellings of parameters."""
    resume: Resume = "restart"
    """How it continues after a suspension, unless the mission says something else with the key `resume`."""

    @property
    def resumes(self) -> tuple[Resume, ...]:
        """Values that the key `resume` of such a block may have."""
        if self.instant:
            return ()
        if self.name == BlockName.BARRIER:
            return ("continue", "abort")
        return ("restart", "continue", "skip", "abort") if self.control else ("restart", "skip", "abort")

    @property
    def can_time_out(self) -> bool:
        """Whether the block may have a successor for its time-out."""
        return not self.instant and self.name != BlockName.WAIT

    @property
    def can_fail(self) -> bool:
        """Whether the block may have a successor for errors; a plug-in may fail with undeclared errors."""
        return bool(self.errors) or not self.control


_POINT: Final = (("x", "x_m"), ("y", "y_m"), ("z", "z_m"), ("yaw", "yaw_rad"), ("speed", "speed_m_s"))
_SPEED: Final = (("speed", "speed_m_s"),)
MOTION_ERRORS: Final = ("blocked", "disarmed", "no_position", "no_navigator")
"""Kinds of error with which a block may end that moves the vehicle to a position."""
_ASKED: Final = ("not_found", "refused", "no_answer")
"""Kinds of error with which a request may end."""

BLOCKS: Final = (
    BlockType(BlockName.START, "Begins the mission.", control=True, instant=True),
    BlockType(
        BlockName.END,
        "Ends the mission and cancels all blocks that still run.",
        End,
        control=True,
        instant=True,
    ),
    BlockType(BlockName.FORK, "Starts all its successors at once.", control=True, instant=True),
    BlockType(
        BlockName.JOIN, "Waits until every branch that leads to it has arrived.", control=True, instant=True
    ),
    BlockType(
        BlockName.DECISION,
        "Takes the first successor whose condition holds, or else `next`.",
        control=True,
        instant=True,
        errors=("unknown_value",),
    ),
    BlockType(
        BlockName.DECISION_RANDOM,
        "Takes one of two successors at random.",
        DecisionRandom,
        control=True,
        instant=True,
        aliases=(("chanceForTrue", "chance_for_true"),),
    ),
    BlockType(
        BlockName.BARRIER,
        "Waits until all members of the ensemble are there; all leave at one common time.",
        Barrier,
        control=True,
        errors=("broken",),
        resume="continue",
    ),
    BlockType(
        BlockName.WAIT,
        "A pause of `ms` milliseconds or `s` seconds.",
        Wait,
        control=True,
        resume="continue",
    ),
    BlockType(
        BlockName.ARM,
        "Arms the motors.",
        timeout_s=10.0,
        kinds=VEHICLES,
        errors=("refused", "no_vehicle"),
    ),
    BlockType(
        BlockName.DISARM,
        "Disarms the motors.",
        timeout_s=10.0,
        kinds=VEHICLES,
        errors=("refused", "no_vehicle"),
    ),
    BlockType(
        BlockName.TAKEOFF,
        "Climbs straight up to an altitude.",
        Takeoff,
        timeout_s=60.0,
        kinds=(PlatformKind.UAV,),
        errors=MOTION_ERRORS,
        motion=True,
        aliases=(("alt", "altitude_m"), ("altitude", "altitude_m"), *_SPEED),
    ),
    BlockType(
        BlockName.GOTO,
        "Moves to a position.",
        Goto,
        timeout_s=300.0,
        kinds=VEHICLES,
        errors=MOTION_ERRORS,
        motion=True,
        airborne=True,
        aliases=_POINT,
    ),
    BlockType(
        BlockName.WAYPOINTS,
        "Moves to several positions, one after the other.",
        Waypoints,
        timeout_s=1_800.0,
        kinds=VEHICLES,
        errors=MOTION_ERRORS,
        motion=True,
        airborne=True,
        aliases=(("points", "points_m"), *_SPEED, ("loiter", "loiter_s")),
    ),
    BlockType(
        BlockName.RETURN,
        "Moves at its present height to where it was armed; a landed vehicle that flies stays.",
        Return,
        timeout_s=300.0,
        kinds=VEHICLES,
        errors=(*MOTION_ERRORS, "no_home"),
        motion=True,
        aliases=_SPEED,
    ),
    BlockType(
        BlockName.FORMATION,
        "Takes a slot in a formation; with `advance`, keeps it along a course to its end.",
        Formation,
        timeout_s=600.0,
        kinds=VEHICLES,
        errors=(*MOTION_ERRORS, "leader_lost"),
        motion=True,
        airborne=True,
        aliases=(*_SPEED, ("spacing", "spacing_m"), ("offset", "offset_m")),
    ),
    BlockType(
        BlockName.LAND,
        "Lands where it is; a vehicle that does not fly stops.",
        Land,
        timeout_s=120.0,
        kinds=VEHICLES,
        errors=MOTION_ERRORS,
        motion=True,
        aliases=_SPEED,
    ),
    BlockType(
        BlockName.HOLD,
        "Stays where it is.",
        Hold,
        timeout_s=30.0,
        kinds=VEHICLES,
        errors=("no_position", "no_navigator"),
        motion=True,
    ),
    BlockType(
        BlockName.WAIT_FOR_SENSOR,
        "Waits until a sensor delivers values, also a sensor that is plugged in meanwhile.",
        WaitForSensor,
        timeout_s=60.0,
    ),
    BlockType(
        BlockName.WAIT_FOR_RESOURCE,
        "Waits until a resource has a fresh value, also one of a module that starts meanwhile.",
        WaitForResource,
        timeout_s=60.0,
    ),
    BlockType(
        BlockName.REQUEST,
        "Sends a request to a command, and waits for its answer.",
        Request,
        timeout_s=5.0,
        errors=(*_ASKED, "unexpected"),
        # whether a request that was cut off was carried out is not known
        resume="abort",
    ),
    BlockType(
        BlockName.SET_RESOURCE,
        "Sets a resource, or one field of it.",
        SetResource,
        timeout_s=10.0,
        errors=_ASKED,
    ),
    BlockType(
        BlockName.START_MODULE,
        "Starts a service of the platform, and waits until it runs.",
        ModuleService,
        timeout_s=30.0,
        errors=_ASKED,
    ),
    BlockType(
        BlockName.STOP_MODULE,
        "Stops a service of the platform, and waits until it has ended.",
        ModuleService,
        timeout_s=30.0,
        errors=_ASKED,
    ),
    BlockType(
        BlockName.USER_BREAKPOINT,
        "Waits for the answer of an operator.",
        UserBreakpoint,
        timeout_s=5.0,
        errors=("stopped",),
    ),
)
"""Definitions of the built-in blocks."""


class Catalogue:
    """The known block types, by name."""

    def __init__(self, types: tuple[BlockType, ...], unusable: tuple[str, ...] = ()) -> None:
        """`unusable`: the reasons why blocks of installed packages are not among the types."""
        self.unusable = unusable
        self.types: dict[str, BlockType] = {}
        for block in types:
            if block.name in self.types:
                raise MissionError(f"block type {block.name!r}: defined twice; expected one definition")
            self.types[block.name] = block

    def find(self, name: str) -> BlockType | None:
        """The block type of that name, or None if it is unknown."""
        return self.types.get(name)


def built_in() -> Catalogue:
    """The catalogue of built-in blocks."""
    return Catalogue(BLOCKS)
