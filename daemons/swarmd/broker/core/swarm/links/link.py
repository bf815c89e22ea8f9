"""Life cycle of a neighbour: the states of the link to it, and their transitions."""

from enum import IntEnum
from typing import Final

import msgspec


class LinkState(IntEnum):
    """State of the two directions of a link."""

    DOWN = 0
    """Silent: beacons arrived before, and none arrives now."""
    HEARD = 1
    """Beacons of its accepted session arrive; it has not listed this node yet."""
    UP = 2
    """Both directions work, as its listing of this node shows."""
    HALF_OPEN = 3
    """Beacons arrive, but it does not receive this node: no route uses the link."""
    UNKNOWN = 4
    """No beacon of an accepted session has arrived: a new record, for the time of one call."""
    FORGOTTEN = 5
    """Silent for minutes: its record is removed."""


class LinkEvent(IntEnum):
    """Events of a link."""

    BEACON = 1
    """A beacon of its accepted session arrived."""
    LISTED = 2
    """A beacon lists this node as received."""
    UNLISTED = 3
    """A beacon lists this node as lost, or its listings are overdue."""
    SILENT = 4
    """The beacons of the neighbour are overdue."""
    RESTARTED = 5
    """Another session of the neighbour was accepted."""
    EXPIRED = 6
    """No beacon arrived for the time in which a silent node is shown."""


TRANSITIONS: Final = {
    (LinkState.UNKNOWN, LinkEvent.BEACON): LinkState.HEARD,
    (LinkState.DOWN, LinkEvent.BEACON): LinkState.HEARD,
    (LinkState.HEARD, LinkEvent.LISTED): LinkState.UP,
    (LinkState.HALF_OPEN, LinkEvent.LISTED): LinkState.UP,
    (LinkState.HEARD, LinkEvent.UNLISTED): LinkState.HALF_OPEN,
    (LinkState.UP, LinkEvent.UNLISTED): LinkState.HALF_OPEN,
    (LinkState.UP, LinkEvent.RESTARTED): LinkState.HEARD,
    (LinkState.HALF_OPEN, LinkEvent.RESTARTED): LinkState.HEARD,
    (LinkState.HEARD, LinkEvent.SILENT): LinkState.DOWN,
    (LinkState.UP, LinkEvent.SILENT): LinkState.DOWN,
    (LinkState.HALF_OPEN, LinkEvent.SILENT): LinkState.DOWN,
    (LinkState.DOWN, LinkEvent.EXPIRED): LinkState.FORGOTTEN,
}
"""The whole life of a neighbour; any other event leaves its state unchanged.

A node has no record before its session is accepted: replayed beacons could fill the table with records.
"""
RECEIVED: Final = frozenset([LinkState.HEARD, LinkState.UP, LinkState.HALF_OPEN])
"""States in which the beacons of a neighbour arrive."""


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
"""A round trip above the first time adds to the cost, up to this at the second one, as babeld's
`rtt-min`, `rtt-max` and `max-rtt-penalty`. A full queue alone never turns a route, whose hysteresis is as
large."""
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
