"""The blocks of the language: what each is for, its parameters, its ways to end.

One table; the loader, the checks, the JSON Schema, the documentation and the player derive from it.
"""

from importlib.metadata import entry_points
from typing import Annotated, Final, Literal

import msgspec

from swarmware.errors import InvalidInput, MissionError

GROUP: Final = "swarmware.blocks"
"""Entry-point group of third parties' blocks."""

VEHICLES: Final = ("uav", "ugv", "usv")
"""Platform kinds that move."""
FLYING: Final = "uav"
"""The kind that leaves the ground."""

Points = tuple[tuple[float, ...], ...]
"""Positions in the map frame, metres."""

Positive = Annotated[float, msgspec.Meta(gt=0, le=86_400)]
Speed = Annotated[float, msgspec.Meta(gt=0, le=30)]
Metres = Annotated[float, msgspec.Meta(ge=-100_000, le=100_000)]
Altitude = Annotated[float, msgspec.Meta(gt=0, le=1_000)]
Distance = Annotated[float, msgspec.Meta(gt=0, le=1_000)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]


class Params(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of a block; a block type has a subclass with its own."""

    @property
    def lasts_s(self) -> float:
        """Time that the parameters ask for, so that the type's default time-out begins after it."""
        return 0.0


class Nothing(Params, frozen=True):
    """The block takes no parameters."""


class End(Params, frozen=True):
    """How the mission went."""

    result: Literal["done", "failed"] = "done"
    """`failed` on a way that was safe but not what the mission was for; then `on_failure` follows."""


class DecisionRandom(Params, frozen=True):
    """A throw of dice."""

    chance_for_true: Ratio
    """Chance of the first successor."""


class Barrier(Params, frozen=True):
    """A meeting of the ensemble."""

    id: Annotated[str, msgspec.Meta(min_length=1, max_length=64, pattern="^[^@]")]
    """Same id, same barrier, in every member's mission; @ begins those of the system."""
    quorum: Literal["all"] | Annotated[int, msgspec.Meta(ge=1, le=1_000)] = "all"
    """How many members open it: all that are still there, or a number."""
    roles: tuple[Name, ...] = ()
    """Roles that meet here; empty: all."""


class Wait(Params, frozen=True):
    """A pause; exactly one of the two."""

    ms: Annotated[float, msgspec.Meta(ge=0, le=86_400_000)] | msgspec.UnsetType = msgspec.UNSET
    s: Annotated[float, msgspec.Meta(ge=0, le=86_400)] | msgspec.UnsetType = msgspec.UNSET

    def __post_init__(self) -> None:
        """Exactly one unit."""
        if (self.ms is msgspec.UNSET) == (self.s is msgspec.UNSET):
            raise InvalidInput("expected exactly one of `ms` and `s`")

    @property
    def duration_s(self) -> float:
        """Length of the pause."""
        if not isinstance(self.ms, msgspec.UnsetType):
            return self.ms / 1000
        return 0.0 if isinstance(self.s, msgspec.UnsetType) else self.s


class Takeoff(Params, frozen=True):
    """Climb straight up to an altitude."""

    altitude_m: Altitude
    """Above the map's origin."""
    speed_m_s: Speed = 1.5


class Goto(Params, frozen=True):
    """Move to one position."""

    x_m: Metres
    y_m: Metres
    z_m: Metres | None = None
    """Without it a vehicle that flies keeps its height."""
    yaw_rad: Annotated[float, msgspec.Meta(ge=-6.3, le=6.3)] | None = None
    """Heading at the end; without it the vehicle arrives as it comes."""
    speed_m_s: Speed = 1.5


class Return(Params, frozen=True):
    """Back to the start."""

    speed_m_s: Speed = 2.0


class Formation(Params, frozen=True):
    """A slot in a moving shape."""

    leader: Name
    """Platform that leads; the leader's own mission names itself."""
    shape: Literal["wedge", "line", "column"] = "wedge"
    slot: Annotated[int, msgspec.Meta(ge=0, le=1_000)] = 0
    """Place in the shape: 0 is its head, then left and right in turn."""
    spacing_m: Distance = 4.0
    """Between neighbouring slots, along and across."""
    offset_m: Annotated[tuple[float, ...], msgspec.Meta(min_length=3, max_length=3)] = (0.0, 0.0, 0.0)
    """Where the shape's head is, seen from the leader: forward, left, up."""
    course: Points = ()
    """Waypoints of the leader, x and y."""
    advance: bool = False
    """Move along the course; without it the slots are taken and kept."""
    speed_m_s: Speed = 1.5
    tolerance_m: Distance = 1.0
    """Formation error below which the slot counts as taken."""
    settle_s: Annotated[float, msgspec.Meta(ge=0, le=60)] = 1.0
    """How long the error must stay below."""

    def __post_init__(self) -> None:
        """Waypoints are pairs, and who advances has some."""
        if any(len(point) != 2 for point in self.course):
            raise InvalidInput("course: expected pairs [x, y] in metres")
        if self.advance and not self.course:
            raise InvalidInput("advance without a course: expected at least one waypoint in `course`")


class Land(Params, frozen=True):
    """Straight down, or at a spot."""

    speed_m_s: Speed = 1.0


class Hold(Params, frozen=True):
    """Stay at the present position."""

    s: Annotated[float, msgspec.Meta(ge=0, le=86_400)] = 0.0
    """For how long; 0: until the vehicle stands still, which it then keeps doing."""

    @property
    def lasts_s(self) -> float:
        """The time for which the block holds."""
        return self.s


class BlockType(msgspec.Struct, frozen=True):
    """What the language knows of one block."""

    name: str
    purpose: str
    """One sentence."""
    params: type[Params] = Nothing
    control: bool = False
    """Played by the player itself; otherwise a plugin does the work."""
    timeout_s: float | None = None
    """Time-out when the mission gives none; None: it needs none."""
    kinds: tuple[str, ...] = ()
    """Platform kinds that can do it; empty: every one."""
    errors: tuple[str, ...] = ()
    """Kinds of error it can end with."""
    motion: bool = False
    """Moves the vehicle; cancelled, it commands hold."""
    instant: bool = False
    """Takes no time, so a loop of nothing else would never rest."""
    aliases: tuple[tuple[str, str], ...] = ()
    """Other spellings of parameters, and what they mean."""

    @property
    def can_time_out(self) -> bool:
        """Whether a time-out successor makes sense."""
        return not self.instant and self.name != "Wait"

    @property
    def can_fail(self) -> bool:
        """Whether an error successor makes sense; a plugin can fail in ways that it does not name."""
        return bool(self.errors) or not self.control


_POINT: Final = (("x", "x_m"), ("y", "y_m"), ("z", "z_m"), ("yaw", "yaw_rad"), ("speed", "speed_m_s"))
_SPEED: Final = (("speed", "speed_m_s"),)
_MOVES: Final = ("blocked", "disarmed", "no_position", "no_navigator")

BLOCKS: Final = (
    BlockType("Start", "Where the mission begins.", control=True, instant=True),
    BlockType("End", "Ends the mission and cancels what still runs.", End, control=True, instant=True),
    BlockType("Fork", "Starts all its successors at once.", control=True, instant=True),
    BlockType("Join", "Waits until every branch that leads to it has arrived.", control=True, instant=True),
    BlockType(
        "Decision",
        "Takes the first successor whose condition holds, else `next`.",
        control=True,
        instant=True,
        errors=("unknown_value",),
    ),
    BlockType(
        "DecisionRandom",
        "Takes one of two successors by chance.",
        DecisionRandom,
        control=True,
        instant=True,
        aliases=(("chanceForTrue", "chance_for_true"),),
    ),
    BlockType(
        "Barrier",
        "Waits until all members of the ensemble are there; all leave at one common time.",
        Barrier,
        control=True,
        errors=("broken",),
    ),
    BlockType("Wait", "A pause of `ms` milliseconds or `s` seconds.", Wait, control=True),
    BlockType("Arm", "Arms the motors.", timeout_s=10.0, kinds=VEHICLES, errors=("refused", "no_vehicle")),
    BlockType(
        "Disarm", "Disarms the motors.", timeout_s=10.0, kinds=VEHICLES, errors=("refused", "no_vehicle")
    ),
    BlockType(
        "Takeoff",
        "Climbs straight up to an altitude.",
        Takeoff,
        timeout_s=60.0,
        kinds=("uav",),
        errors=_MOVES,
        motion=True,
        aliases=(("alt", "altitude_m"), ("altitude", "altitude_m"), *_SPEED),
    ),
    BlockType(
        "Goto",
        "Moves to a position.",
        Goto,
        timeout_s=300.0,
        kinds=VEHICLES,
        errors=_MOVES,
        motion=True,
        aliases=_POINT,
    ),
    BlockType(
        "Return",
        "Moves at its present height to where it was armed; a landed vehicle that flies stays.",
        Return,
        timeout_s=300.0,
        kinds=VEHICLES,
        errors=(*_MOVES, "no_home"),
        motion=True,
        aliases=_SPEED,
    ),
    BlockType(
        "Formation",
        "Takes a slot in a formation; with `advance`, keeps it along a course to its end.",
        Formation,
        timeout_s=600.0,
        kinds=VEHICLES,
        errors=(*_MOVES, "leader_lost"),
        motion=True,
        aliases=(*_SPEED, ("spacing", "spacing_m"), ("offset", "offset_m")),
    ),
    BlockType(
        "Land",
        "Lands where it is; a vehicle that does not fly stops.",
        Land,
        timeout_s=120.0,
        kinds=VEHICLES,
        errors=_MOVES,
        motion=True,
        aliases=_SPEED,
    ),
    BlockType(
        "Hold",
        "Stays where it is.",
        Hold,
        timeout_s=30.0,
        kinds=VEHICLES,
        errors=("no_position", "no_navigator"),
        motion=True,
    ),
)
"""The built-in blocks."""


class Catalogue:
    """The block types known here, by name."""

    def __init__(self, types: tuple[BlockType, ...]) -> None:
        self.types: dict[str, BlockType] = {}
        for block in types:
            if block.name in self.types:
                raise MissionError(f"block type {block.name!r}: defined twice; expected one definition")
            self.types[block.name] = block

    def find(self, name: str) -> BlockType | None:
        """The type of that name."""
        return self.types.get(name)


def built_in() -> Catalogue:
    """The blocks that are always there."""
    return Catalogue(BLOCKS)


def installed() -> Catalogue:
    """The built-in blocks and those of installed packages.

    Raises: MissionError when a package's entry point is not a block, or takes a name that is in use.
    """
    foreign: list[BlockType] = []
    for point in entry_points(group=GROUP):
        spec = getattr(point.load(), "spec", None)
        if not isinstance(spec, BlockType):
            raise MissionError(f"entry point {GROUP}:{point.name}: expected a class with `spec: BlockType`")
        foreign.append(spec)
    return Catalogue((*BLOCKS, *foreign))
