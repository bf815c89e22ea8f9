"""How far a value can be trusted: its owner, its age, the way to it."""

from enum import StrEnum
from typing import Final

from swarmd.tree.core.index import Leaf

BEACON_S: Final = 1.25
"""A board of another platform that does not change comes with a beacon each half second; after 2.5 periods
without any the link itself is down."""


class Quality(StrEnum):
    """Of a resource's value as it is seen here."""

    LIVE = "live"
    STALE = "stale"
    """Older than it may be, or of unknown age."""
    LOST = "lost"
    """Its owner has gone, or its platform cannot be reached."""
    NONE = "none"
    """No value has been seen here."""


def quality(
    leaf: Leaf, age_s: float | None, *, reachable: bool, known: bool, mirrored: bool = False
) -> Quality:
    """Quality of a resource. `known`: there is a value; `age_s`: None when its clock is not known here.

    `mirrored`: it came from another platform, whose beacons leave out what has not changed.
    """
    if leaf.lost or not reachable:
        return Quality.LOST
    if not known:
        return Quality.NONE
    limit_s = leaf.resource.stale_after_s
    if mirrored and leaf.resource.link == "tick":
        limit_s = max(limit_s, BEACON_S)
    if age_s is None:
        return Quality.LIVE if limit_s == float("inf") else Quality.STALE
    return Quality.LIVE if age_s <= limit_s else Quality.STALE
