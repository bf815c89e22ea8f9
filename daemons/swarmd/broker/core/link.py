"""States of a link to a neighbour, and what leads from one to another."""

from enum import IntEnum
from typing import Final

import msgspec


class LinkState(IntEnum):
    """What is known of the two directions to a neighbour."""

    DOWN = 0
    HEARD = 1
    """We hear it; it has not said yet that it hears us."""
    UP = 2
    HALF_OPEN = 3
    """We hear it, it does not hear us: useless for anything but its news."""


class LinkEvent(IntEnum):
    """What happens to a link."""

    DATAGRAM = 1
    LISTED = 2
    UNLISTED = 3
    SILENT = 4
    RESTARTED = 5


TRANSITIONS: Final = {
    (LinkState.DOWN, LinkEvent.DATAGRAM): LinkState.HEARD,
    (LinkState.HEARD, LinkEvent.LISTED): LinkState.UP,
    (LinkState.HALF_OPEN, LinkEvent.LISTED): LinkState.UP,
    (LinkState.HEARD, LinkEvent.UNLISTED): LinkState.HALF_OPEN,
    (LinkState.UP, LinkEvent.UNLISTED): LinkState.HALF_OPEN,
    (LinkState.UP, LinkEvent.RESTARTED): LinkState.HEARD,
    (LinkState.HALF_OPEN, LinkEvent.RESTARTED): LinkState.HEARD,
    (LinkState.HEARD, LinkEvent.SILENT): LinkState.DOWN,
    (LinkState.UP, LinkEvent.SILENT): LinkState.DOWN,
    (LinkState.HALF_OPEN, LinkEvent.SILENT): LinkState.DOWN,
}
"""The only place where a link's state changes; what is not in it changes nothing."""


class LinkChanged(msgspec.Struct, frozen=True, gc=False):
    """A link went into another state."""

    hw: int
    before: LinkState
    after: LinkState
    event: LinkEvent
