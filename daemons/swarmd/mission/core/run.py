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
    """Rows that precede the reactions of the platform while the mission runs."""
    priority: int = 0
    by: str = ""
    """Name of the sender of the order, or "" if it is not known."""

    def strict_barriers(self) -> frozenset[str]:
        """Ids of the barriers that name the role of a ground station, which must then be present."""
        stations = {member.role for member in self.members if member.kind == PlatformKind.GCS}
        params = [block.params for block in self.mission.barriers]
        return frozenset(p.id for p in params if isinstance(p, Barrier) and stations & set(p.roles))


PLAYING: Final = frozenset({MissionPhase.RUNNING, MissionPhase.RECOVERING})
"""Phases in which blocks run and may move the vehicle."""
MAKING_WAY: Final = frozenset({MissionPhase.SUSPENDING, MissionPhase.SUSPENDED})
"""Phases of a mission that another one precedes."""


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
    SUSPEND = "suspend"
    """A run of higher priority, or a reaction, is to be played first."""
    STOPPED = "stopped"
    """All blocks of the suspended mission have ended."""
    RESUME = "resume"


TRANSITIONS: Final[dict[tuple[MissionPhase, PhaseEvent], MissionPhase]] = {
    (MissionPhase.IDLE, PhaseEvent.ORDER): MissionPhase.READY,
    (MissionPhase.DONE, PhaseEvent.ORDER): MissionPhase.READY,
    (MissionPhase.FAILED, PhaseEvent.ORDER): MissionPhase.READY,
    (MissionPhase.ABORTED, PhaseEvent.ORDER): MissionPhase.READY,
    # a requirement is no longer met when the turn of the mission has come
    (MissionPhase.IDLE, PhaseEvent.WITHDRAWN): MissionPhase.IDLE,
    (MissionPhase.READY, PhaseEvent.BEGIN): MissionPhase.RUNNING,
    (MissionPhase.READY, PhaseEvent.WITHDRAWN): MissionPhase.IDLE,
    (MissionPhase.RUNNING, PhaseEvent.STOP): MissionPhase.ENDING,
    (MissionPhase.RUNNING, PhaseEvent.SUSPEND): MissionPhase.SUSPENDING,
    (MissionPhase.SUSPENDING, PhaseEvent.STOPPED): MissionPhase.SUSPENDED,
    (MissionPhase.SUSPENDING, PhaseEvent.STOP): MissionPhase.ENDING,
    (MissionPhase.SUSPENDED, PhaseEvent.RESUME): MissionPhase.RUNNING,
    (MissionPhase.SUSPENDED, PhaseEvent.STOP): MissionPhase.ENDING,
    # a mission that waits at the common start makes way without having begun
    (MissionPhase.READY, PhaseEvent.SUSPEND): MissionPhase.SUSPENDED,
    (MissionPhase.SUSPENDED, PhaseEvent.ORDER): MissionPhase.READY,
    (MissionPhase.SUSPENDED, PhaseEvent.WITHDRAWN): MissionPhase.IDLE,
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


RESUMED: Final = "resumed"
"""Event of a block that continues after its mission was suspended."""
STARTED: Final = "started"
"""Event of a block that begins."""


class ProgressStep(msgspec.Struct, frozen=True):
    """A progress event for operators and the log."""

    block: str
    """Id of the block, or "" for the mission as a whole."""
    type: str
    event: str
    text: str = ""
    mission: str = ""
    """Name of the mission that is played, perhaps a built-in one."""
    epoch: int = 0
    """Run of the step, or 0 without a run."""


class PlaySuspended(msgspec.Struct, frozen=True):
    """No block of the suspended play runs any more."""


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
    """True if by order of an operator; otherwise only a vehicle that no operator drives is taken."""


PlayerAction = (
    StartBlock | CancelBlock | EnterBarrier | LeaveBarrier | ProgressStep | PlaySuspended | PlayEnded
)
Action = StartBlock | CancelBlock | ProgressStep | Announce | TakeVehicle
"""Actions for the shell; the executor handles barriers and ends itself."""
