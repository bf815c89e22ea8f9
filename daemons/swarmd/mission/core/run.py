"""One run of a mission on one platform: its order, phases, results and actions."""

from enum import StrEnum
from typing import Final

import msgspec

from swarmware.errors import Conflict
from swarmware.mission.catalogue import Barrier
from swarmware.mission.model import Block, MissionDefinition
from swarmware.mission.reaction import ReactionRow
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import Member, MissionPhase, MissionState


class Run(msgspec.Struct, frozen=True):
    """An accepted order: the mission and its members."""

    mission: MissionDefinition
    name: str
    hash: str
    epoch: int
    role: str
    members: tuple[Member, ...]
    reactions: tuple[ReactionRow, ...] = ()
    """Rows that precede those of the platform while the mission runs."""

    def strict_barriers(self) -> frozenset[str]:
        """Ids of the barriers that name the role of a ground station, which must then be present."""
        stations = {member.role for member in self.members if member.kind == PlatformKind.GCS}
        params = [block.params for block in self.mission.barriers]
        return frozenset(p.id for p in params if isinstance(p, Barrier) and stations & set(p.roles))


PLAYING: Final = frozenset({MissionPhase.RUNNING, MissionPhase.RECOVERING})


class PhaseEvent(StrEnum):
    """Event that changes the phase of a mission."""

    ORDER = "order"
    BEGIN = "begin"
    STOP = "stop"
    DONE = "done"
    FAILED = "failed"
    ABORTED = "aborted"
    RECOVER = "recover"
    WITHDRAWN = "withdrawn"
    """The order is withdrawn before any member has begun."""


TRANSITIONS: Final[dict[tuple[MissionPhase, PhaseEvent], MissionPhase]] = {
    (MissionPhase.IDLE, PhaseEvent.ORDER): MissionPhase.READY,
    (MissionPhase.DONE, PhaseEvent.ORDER): MissionPhase.READY,
    (MissionPhase.FAILED, PhaseEvent.ORDER): MissionPhase.READY,
    (MissionPhase.ABORTED, PhaseEvent.ORDER): MissionPhase.READY,
    (MissionPhase.READY, PhaseEvent.BEGIN): MissionPhase.RUNNING,
    (MissionPhase.READY, PhaseEvent.WITHDRAWN): MissionPhase.IDLE,
    (MissionPhase.RUNNING, PhaseEvent.STOP): MissionPhase.ENDING,
    (MissionPhase.RECOVERING, PhaseEvent.STOP): MissionPhase.ENDING,
    (MissionPhase.ENDING, PhaseEvent.DONE): MissionPhase.DONE,
    (MissionPhase.ENDING, PhaseEvent.FAILED): MissionPhase.FAILED,
    (MissionPhase.ENDING, PhaseEvent.ABORTED): MissionPhase.ABORTED,
    (MissionPhase.ENDING, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
    # without a mission the operator may still order a built-in one: land, hold, return
    (MissionPhase.IDLE, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
    (MissionPhase.DONE, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
    (MissionPhase.FAILED, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
    (MissionPhase.ABORTED, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
}


def follow(phase: MissionPhase, event: PhaseEvent) -> MissionPhase:
    """The phase after an event.

    Raises: Conflict when the event is not allowed in this phase.
    """
    try:
        return TRANSITIONS[phase, event]
    except KeyError:
        raise Conflict(f"mission is {phase}: expected another state for {event!r}") from None


class PlayResult(StrEnum):
    """Result of a play."""

    DONE = "done"
    FAILED = "failed"
    ABORTED = "aborted"


class StartBlock(msgspec.Struct, frozen=True):
    """The shell starts this functional block and reports its end with the token."""

    token: int
    block: Block


class CancelBlock(msgspec.Struct, frozen=True):
    """The shell cancels that block, and still reports its end."""

    token: int


class EnterBarrier(msgspec.Struct, frozen=True):
    """The mission has arrived at a barrier."""

    token: int
    block: Block
    visit: int
    """Number of this visit, from 1."""


class LeaveBarrier(msgspec.Struct, frozen=True):
    """The mission no longer waits at the barrier."""

    token: int


STARTED: Final = "started"
"""Event of a block that begins."""


class ProgressStep(msgspec.Struct, frozen=True):
    """A progress event for operators and the log."""

    block: str
    """Id of the block; empty: the mission as a whole."""
    type: str
    event: str
    text: str = ""
    mission: str = ""
    """Name of the mission that is played, perhaps a built-in one."""


class PlayEnded(msgspec.Struct, frozen=True):
    """The play is over and no block of it runs any more."""

    result: PlayResult
    reason: str = ""


class Announce(msgspec.Struct, frozen=True):
    """The shell writes the state to its board: it has changed, or the heartbeat is due."""

    state: MissionState


class TakeVehicle(msgspec.Struct, frozen=True):
    """The shell asks for the vehicle, which is driven by hand: a built-in mission is to move it."""

    ordered: bool
    """By an operator; otherwise only a vehicle that no operator drives is taken."""


PlayerAction = StartBlock | CancelBlock | EnterBarrier | LeaveBarrier | ProgressStep | PlayEnded
Action = StartBlock | CancelBlock | ProgressStep | Announce | TakeVehicle
"""Actions for the shell; the executor handles barriers and ends itself."""
