"""The lead of a barrier: the time from its opening to the common instant at which all members leave."""

from collections.abc import Collection
from typing import Final

from swarmware.types.net import Neighbours, Routes

LEAD_BEACONS: Final = 2.5
"""Beacon periods per hop for a barrier result: the next beacon carries it, or the one after if that is
lost."""
LEAD_MAX_NS: Final = 5_000_000_000


def lead_ns(min_ns: int, beacon_hz: float, hops: int) -> int:
    """The lead for members at a maximum hop count, at the lowest beacon rate on the route."""
    if beacon_hz <= 0:
        return min_ns
    return max(min_ns, min(round(LEAD_BEACONS * max(hops, 1) * 1e9 / beacon_hz), LEAD_MAX_NS))


def lead_to_ns(
    platforms: Collection[str],
    *,
    min_ns: int,
    own_hz: float,
    routes: Routes | None,
    neighbours: Neighbours | None,
) -> int:
    """The lead for these members, with the present routes and beacon rates.

    `own_hz`: beacon rate of this node; 0: not known. The rates of nodes that relay to a member are included.
    """
    ways = [route for route in routes.routes if route.platform in platforms] if routes else []
    relays = {route.via for route in ways if route.hops > 1}
    known = neighbours.neighbours if neighbours else ()
    rates_hz = [own_hz, *(each.tick_hz for each in known if each.name in relays)]
    slowest_hz = min((hz for hz in rates_hz if hz > 0), default=0.0)
    return lead_ns(min_ns, slowest_hz, max((route.hops for route in ways), default=1))
