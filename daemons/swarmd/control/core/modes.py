"""The table of modes: which source reaches the chassis in each mode, and which events change the mode."""

from enum import StrEnum
from typing import Final

from swarmware.types.control import DriveEvent, DriveMode


class Source(StrEnum):
    """Sender of a set-point."""

    NAVIGATOR = "navigator"
    OPERATOR = "operator"
    PILOT = "pilot"


class Decision(StrEnum):
    """Treatment of a set-point: passed on, ignored or refused."""

    PASS = "passed on"
    IGNORE = "ignored"
    REFUSE = "refused"


DECISIONS: Final[dict[tuple[DriveMode, Source], Decision]] = {
    (DriveMode.AUTO, Source.NAVIGATOR): Decision.PASS,
    (DriveMode.AUTO, Source.OPERATOR): Decision.REFUSE,
    (DriveMode.AUTO, Source.PILOT): Decision.IGNORE,
    (DriveMode.MANUAL, Source.NAVIGATOR): Decision.IGNORE,
    (DriveMode.MANUAL, Source.OPERATOR): Decision.PASS,
    (DriveMode.MANUAL, Source.PILOT): Decision.IGNORE,
    (DriveMode.HOLD, Source.NAVIGATOR): Decision.IGNORE,
    (DriveMode.HOLD, Source.OPERATOR): Decision.PASS,
    (DriveMode.HOLD, Source.PILOT): Decision.IGNORE,
    (DriveMode.PILOT, Source.NAVIGATOR): Decision.IGNORE,
    (DriveMode.PILOT, Source.OPERATOR): Decision.REFUSE,
    (DriveMode.PILOT, Source.PILOT): Decision.PASS,
}
"""Treatment of a set-point by mode and source; the operator has the stick, the pilot the vehicle's switch."""

_AUTO, _MANUAL, _HOLD, _PILOT = DriveMode.AUTO, DriveMode.MANUAL, DriveMode.HOLD, DriveMode.PILOT

TRANSITIONS: Final[dict[tuple[DriveMode, DriveEvent], DriveMode | None]] = {
    (_AUTO, DriveEvent.DRIVE): _MANUAL,
    (_AUTO, DriveEvent.SETPOINT): None,
    (_AUTO, DriveEvent.EXPIRED): _AUTO,
    (_AUTO, DriveEvent.RELEASE): _AUTO,
    (_AUTO, DriveEvent.ORDER): _AUTO,
    (_AUTO, DriveEvent.RECOVERY): _AUTO,
    (_AUTO, DriveEvent.SWITCH_MANUAL): _PILOT,
    (_AUTO, DriveEvent.SWITCH_AUTO): _AUTO,
    (_MANUAL, DriveEvent.DRIVE): _MANUAL,
    (_MANUAL, DriveEvent.SETPOINT): _MANUAL,
    (_MANUAL, DriveEvent.EXPIRED): _HOLD,
    (_MANUAL, DriveEvent.RELEASE): _AUTO,
    (_MANUAL, DriveEvent.ORDER): _AUTO,
    # a person flies: the recovery of a failed mission waits until the set-points stop
    (_MANUAL, DriveEvent.RECOVERY): None,
    (_MANUAL, DriveEvent.SWITCH_MANUAL): _PILOT,
    (_MANUAL, DriveEvent.SWITCH_AUTO): _MANUAL,
    (_HOLD, DriveEvent.DRIVE): _MANUAL,
    (_HOLD, DriveEvent.SETPOINT): _MANUAL,
    (_HOLD, DriveEvent.EXPIRED): _HOLD,
    (_HOLD, DriveEvent.RELEASE): _AUTO,
    (_HOLD, DriveEvent.ORDER): _AUTO,
    # the set-points have stopped, so no person flies any more
    (_HOLD, DriveEvent.RECOVERY): _AUTO,
    (_HOLD, DriveEvent.SWITCH_MANUAL): _PILOT,
    (_HOLD, DriveEvent.SWITCH_AUTO): _HOLD,
    (_PILOT, DriveEvent.DRIVE): None,
    (_PILOT, DriveEvent.SETPOINT): None,
    (_PILOT, DriveEvent.EXPIRED): _PILOT,
    (_PILOT, DriveEvent.RELEASE): _PILOT,
    # the safety pilot decides: nothing but the switch ends this mode
    (_PILOT, DriveEvent.ORDER): None,
    (_PILOT, DriveEvent.RECOVERY): None,
    (_PILOT, DriveEvent.SWITCH_MANUAL): _PILOT,
    (_PILOT, DriveEvent.SWITCH_AUTO): _AUTO,
}
"""Mode that follows from a mode and an event, or None if the event is refused in that mode."""
