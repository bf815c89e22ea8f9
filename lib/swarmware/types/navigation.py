"""Goals of the navigator, its state on the way to them, and collisions."""

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.bounds import Finite
from swarmware.types.registry import register


class GoalKind(OpenEnum):
    """Kind of a goal of the navigator."""

    HOLD = "hold"
    GOTO = "goto"
    TAKEOFF = "takeoff"
    LAND = "land"
    """Lands at its position, and without a valid one by its height alone."""
    DESCEND = "descend"
    """Lands by its height alone, at touch-down speed."""
    FORMATION = "formation"


class NavState(OpenEnum):
    """State of the vehicle's motion."""

    IDLE = "idle"
    """No goal, or the motors are off and stay so."""
    MOVING = "moving"
    ARRIVED = "arrived"
    HOLDING = "holding"
    BLOCKED = "blocked"
    """Blocked; `NavStatus.error` has the reason."""


class NavError(OpenEnum):
    """Error that prevents a navigator from reaching its goal."""

    NONE = ""
    DISARMED = "disarmed"
    """The motors are off."""
    LEADER_LOST = "leader_lost"
    """The pose of the formation's leader is missing for too long."""
    NO_POSITION = "no_position"
    """The position of the vehicle is not known."""
    NO_WAY = "no_way"
    """The vehicle makes no progress."""
    BAD_GOAL = "bad_goal"
    """The goal is invalid for this vehicle."""


@register
class Goal(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Goal that the navigator reaches or keeps, set by the mission (board `nav/goal`)."""

    seq: int
    """Number of the goal, which NavStatus repeats."""
    kind: GoalKind
    x_m: Finite = 0.0
    y_m: Finite = 0.0
    z_m: Finite = 0.0
    """Position of goto; takeoff uses only the height."""
    yaw_rad: Finite | None = None
    """goto: heading at the end; without it any heading."""
    speed_m_s: Finite = 1.5
    leader: str = ""
    """Formation: platform of the leader."""
    offset_m: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """Formation: slot relative to the leader: forward, left, up."""
    course: tuple[tuple[Finite, Finite], ...] = ()
    """Formation: waypoints of the leader; every member knows them."""
    advance: bool = False
    """Formation: whether to move along the course; otherwise the slots are at rest."""


@register
class NavStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Status of the navigator for its goal (board `nav/status`)."""

    goal_seq: int
    state: NavState
    distance_m: Finite = 0.0
    """Distance to the goal; in a formation to the own slot, of an advancing leader to the end of the
    course."""
    formation_error_m: Finite = 0.0
    note: str = ""
    """Text for operators."""
    error: NavError = NavError.NONE
    """Error that determines how the motion of a mission ends."""
    circle_m: Finite = 0.0
    """Radius of the circle on which a vehicle that cannot stop keeps a place, or 0 if it can stop."""


@register
class Collision(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Collision of the vehicle (event `sim/collision`)."""

    other: str
    """Name of the obstacle or platform."""
    x_m: float
    y_m: float
    z_m: float
    speed_m_s: float
