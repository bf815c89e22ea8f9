"""A condition that a driver states about its device: one check of the health monitor."""

import msgspec

from swarmware.types.health import OK_STATE, Level


class Condition(msgspec.Struct, frozen=True):
    """The state of one check of a device."""

    name: str
    """Name of the check: `flight/loop`."""
    description: str
    state: str = OK_STATE
    level: Level = "ok"
    detail: str = ""
    """Freeze frame of the fault: what was measured when it began."""
