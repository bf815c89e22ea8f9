"""Quality and rate of the values of a resource: from their owner, their ages, and the reachable platforms."""

from typing import Final

from swarmd.tree.core.structure.index import Leaf
from swarmware.model.resource import STALE_PERIODS
from swarmware.types.tree import Quality

BEACON_S: Final = 1.25
"""An unchanged board of another platform is repeated with a beacon each half second; after 2.5 periods
without a beacon the link is down."""


def quality(
    leaf: Leaf,
    age_s: float | None,
    *,
    reachable: bool,
    known: bool,
    mirrored: bool = False,
    interval_s: float = 0.0,
) -> Quality:
    """Quality of a resource. `known`: there is a value; `age_s`: None when its clock is not known here.

    `mirrored`: it is of another platform, whose beacons omit unchanged values; `interval_s`:
    between two values of it, where a subscription or an operator has made that longer than its period.
    """
    # before the age: a value without an owner is not live, however new it is
    if leaf.lost or not reachable:
        return Quality.LOST
    if not known:
        return Quality.NONE
    limit_s = max(leaf.resource.stale_after_s, STALE_PERIODS * interval_s)
    if mirrored and leaf.resource.link == "tick":
        limit_s = max(limit_s, BEACON_S)
    if age_s is None:
        return Quality.LIVE if limit_s == float("inf") else Quality.STALE
    return Quality.LIVE if age_s <= limit_s else Quality.STALE


SILENCE: Final = 2.0
"""Periods without a value from which the silence counts, too."""


def measured_hz(values: int, span_s: float, age_s: float | None) -> float | None:
    """Rate of a resource of which `values` were written within `span_s` after an older one.

    `age_s`: time since the newest; when it exceeds the usual period the rate falls towards 0. None: no rate.
    """
    if values <= 0 or span_s <= 0:
        return None
    period_s = span_s / values
    if age_s is not None and age_s > SILENCE * period_s:
        # a writer that has stopped shows a falling rate, not its last one for ever
        span_s += age_s
    return values / span_s
