"""The states of a platform's mission, and nothing else that sets them."""

from enum import StrEnum
from typing import Final

from swarmware.errors import Conflict


class MissionPhase(StrEnum):
    """Where a platform stands in its mission."""

    IDLE = "idle"
    READY = "ready"
    """Accepted; waits until all others have, too."""
    RUNNING = "running"
    ENDING = "ending"
    """What still runs is being cancelled."""
    RECOVERING = "recovering"
    """A built-in mission brings the vehicle to safety."""
    DONE = "done"
    FAILED = "failed"
    ABORTED = "aborted"


REST: Final = frozenset({MissionPhase.IDLE, MissionPhase.DONE, MissionPhase.FAILED, MissionPhase.ABORTED})
"""Nothing is played."""


class PhaseEvent(StrEnum):
    """What moves it on."""

    ORDER = "order"
    BEGIN = "begin"
    STOP = "stop"
    DONE = "done"
    FAILED = "failed"
    ABORTED = "aborted"
    RECOVER = "recover"
    WITHDRAWN = "withdrawn"
    """The order is taken back before anybody has begun."""


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
    # without a mission the operator may still ask for a built-in one: land, hold
    (MissionPhase.IDLE, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
    (MissionPhase.DONE, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
    (MissionPhase.FAILED, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
    (MissionPhase.ABORTED, PhaseEvent.RECOVER): MissionPhase.RECOVERING,
}


def follow(phase: MissionPhase, event: PhaseEvent) -> MissionPhase:
    """The phase after an event.

    Raises: Conflict when the event does not belong there.
    """
    try:
        return TRANSITIONS[phase, event]
    except KeyError:
        raise Conflict(f"mission is {phase}: expected another state for {event!r}") from None
