"""What the cores ask of the shell."""

import msgspec

from swarmware.mission.model import Block
from swarmware.types.mission import MissionState


class StartBlock(msgspec.Struct, frozen=True):
    """Run this functional block; its end comes back with the token."""

    token: int
    block: Block


class CancelBlock(msgspec.Struct, frozen=True):
    """Cancel that block; it still reports its end."""

    token: int


class EnterBarrier(msgspec.Struct, frozen=True):
    """The mission has come to a barrier."""

    token: int
    block: Block
    visit: int
    """Counts from 1."""


class LeaveBarrier(msgspec.Struct, frozen=True):
    """The mission waits there no longer."""

    token: int


class ProgressStep(msgspec.Struct, frozen=True):
    """Something happened that an operator and the log want to know."""

    block: str
    """Empty: the mission as a whole."""
    type: str
    event: str
    text: str = ""
    mission: str = ""
    """What is played: the mission, or a built-in one."""


class PlayEnded(msgspec.Struct, frozen=True):
    """The play is over and nothing of it runs any more."""

    result: str
    """done | failed | aborted."""
    reason: str = ""


class Announce(msgspec.Struct, frozen=True):
    """Put the state onto its board: it has changed, or it is time for a sign of life."""

    state: MissionState


PlayerAction = StartBlock | CancelBlock | EnterBarrier | LeaveBarrier | ProgressStep | PlayEnded
Action = StartBlock | CancelBlock | ProgressStep | Announce
"""What leaves the mission core: barriers and ends are its own business."""
