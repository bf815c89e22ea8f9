"""State machine of a link to a neighbour."""

from enum import IntEnum
from typing import Final

import msgspec


class LinkState(IntEnum):
    """State of the two directions of a link."""

    DOWN = 0
    HEARD = 1
    """Received; it has not listed us yet."""
    UP = 2
    HALF_OPEN = 3
    """Received, but it does not receive us: no route uses the link."""


class LinkEvent(IntEnum):
    """Events of a link."""

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
"""All transitions; any other event leaves the state unchanged."""


class LinkChanged(msgspec.Struct, frozen=True, gc=False):
    """A transition of a link."""

    hw: int
    before: LinkState
    after: LinkState
    event: LinkEvent
    worked_ns: int = 0
    """Own clock when the direction that failed worked last; of a link that does not fail without meaning."""
