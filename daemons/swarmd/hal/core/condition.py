"""Conditions that drivers report about their devices, as checks of the health monitor."""

import msgspec

from swarmware.types.health import OK_STATE, Level


class Condition(msgspec.Struct, frozen=True):
    """The state of one check of a device."""

    name: str
    """Name of the check, such as `flight/loop`."""
    description: str
    state: str = OK_STATE
    level: Level = "ok"
    detail: str = ""
    """Freeze frame of the fault, with the measurements at its beginning."""
