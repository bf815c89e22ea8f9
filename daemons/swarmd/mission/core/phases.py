"""The states of a platform's mission, and nothing else that sets them."""

from enum import StrEnum
from typing import Final

from swarmware.errors import Conflict


class Phase(StrEnum):
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


REST: Final = frozenset({Phase.IDLE, Phase.DONE, Phase.FAILED, Phase.ABORTED})
"""Nothing is played."""


class Event(StrEnum):
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


TRANSITIONS: Final[dict[tuple[Phase, Event], Phase]] = {
    (Phase.IDLE, Event.ORDER): Phase.READY,
    (Phase.DONE, Event.ORDER): Phase.READY,
    (Phase.FAILED, Event.ORDER): Phase.READY,
    (Phase.ABORTED, Event.ORDER): Phase.READY,
    (Phase.READY, Event.BEGIN): Phase.RUNNING,
    (Phase.READY, Event.WITHDRAWN): Phase.IDLE,
    (Phase.RUNNING, Event.STOP): Phase.ENDING,
    (Phase.RECOVERING, Event.STOP): Phase.ENDING,
    (Phase.ENDING, Event.DONE): Phase.DONE,
    (Phase.ENDING, Event.FAILED): Phase.FAILED,
    (Phase.ENDING, Event.ABORTED): Phase.ABORTED,
    (Phase.ENDING, Event.RECOVER): Phase.RECOVERING,
    # without a mission the operator may still ask for a built-in one: land, hold
    (Phase.IDLE, Event.RECOVER): Phase.RECOVERING,
    (Phase.DONE, Event.RECOVER): Phase.RECOVERING,
    (Phase.FAILED, Event.RECOVER): Phase.RECOVERING,
    (Phase.ABORTED, Event.RECOVER): Phase.RECOVERING,
}


def follow(phase: Phase, event: Event) -> Phase:
    """The phase after an event.

    Raises: Conflict when the event does not belong there.
    """
    try:
        return TRANSITIONS[phase, event]
    except KeyError:
        raise Conflict(f"mission is {phase}: expected another state for {event!r}") from None
