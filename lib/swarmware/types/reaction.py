"""Reactions of a vehicle to faults: the state of the rows, and the inputs of the rows."""

from typing import Annotated

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.bounds import Finite
from swarmware.types.registry import register


class ReactionPhase(OpenEnum):
    """Phase of one row of the reactions."""

    IDLE = "idle"
    """The condition does not hold or is unknown, or the row does not apply where the vehicle is."""
    PENDING = "pending"
    """The condition holds, but not for the hold time yet."""
    ACTIVE = "active"
    """The condition has held for the hold time; the action was taken."""


@register
class ReactionState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of one row."""

    row: str
    """Name of the row."""
    phase: ReactionPhase
    action: str
    """Action of the row; while the row is active, the action that was taken."""
    since_ns: int
    """Own hardware clock when the phase began, or 0 since the start of the daemon."""
    reason: str = ""
    """Reason of a row that is pending or active."""
    note: str = ""
    """Reason for which the row can never act, such as a field that does not exist; else ""."""


@register
class Reactions(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of all rows (board `mission/reactions`), on change."""

    rows: tuple[ReactionState, ...] = ()
    """States in the order of their file; the rows of the mission come first."""


@register
class MissionWatch(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Observations of the mission daemon for reactions (board `mission/watch`), on change."""

    station: bool | None = None
    """Whether a ground station is in reach, or None before the first contact."""
    restarted: bool = False
    """Whether the daemon was started while the vehicle was armed: its former mission is unknown."""


@register
class WayHome(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Charge for the way to the place of arming (board `vehicle/way_home`), once a second while armed."""

    distance_m: Finite
    """Horizontal distance to the place of arming."""
    duration_s: Finite
    """Time of the return and the landing, at the speeds of the built-in mission `return`."""
    remaining_ratio: Annotated[float, msgspec.Meta(ge=-1, le=2)]
    """Remaining charge."""
    needed_ratio: Finite | None = None
    """Charge for the return and the landing at the measured discharge, plus the reserve, or None while the
    discharge is not known."""
