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


PERFECT: Final = 256
"""Cost of a link without loss."""
COST_MAX: Final = 16384
RTT_FREE_NS: Final = 10_000_000
RTT_FULL_NS: Final = 120_000_000
RTT_PENALTY: Final = 96
"""A round trip above the first time adds to the cost, up to this at the second one: babeld's `rtt-min`,
`rtt-max` and `max-rtt-penalty`. A full queue alone never turns a route: its hysteresis is as large."""
_RTT_STEPS: Final = 3
_FULL: Final = 255


def link_cost(quality: int, reported: int, penalty: int, rtt_ns: int) -> int:
    """Square of the expected transmissions, in 1/256, and what a slow medium or a long round trip adds.

    `quality`, `reported`: share that arrives here and there, in 1/255; `penalty`: of the medium. The square
    keeps routes off links at the edge of their range, which end before a moving swarm has turned its routes:
    of 100 nodes at 10 m/s 99.8 % of the pairs have their route, with the plain number 99.2 %, for fewer bytes
    (test_routes_at_speed).
    """
    both = quality * reported
    if not both:
        return COST_MAX
    return min(PERFECT * _FULL**4 // both**2 + penalty + rtt_penalty(rtt_ns), COST_MAX)


def rtt_penalty(rtt_ns: int) -> int:
    """Cost of the round trip, in steps that its scatter does not pass."""
    if rtt_ns <= RTT_FREE_NS:
        return 0
    ratio = min((rtt_ns - RTT_FREE_NS) / (RTT_FULL_NS - RTT_FREE_NS), 1.0)
    return round(ratio * _RTT_STEPS) * (RTT_PENALTY // _RTT_STEPS)


class ConnectionDelay(msgspec.Struct, frozen=True):
    """Round trips of a connection as the kernel measures them."""

    smoothed_ns: int
    min_ns: int
    """Minimum of the last minutes: measured when the connection was opened, too, before it filled a queue."""

    @property
    def excess_ns(self) -> int:
        """Smoothed round trip above the minimum."""
        return max(0, self.smoothed_ns - self.min_ns)
