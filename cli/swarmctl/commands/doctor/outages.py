"""Outages of a node's links: links that are lost now, and links that do not hold."""

from collections import defaultdict
from collections.abc import Iterable
from typing import Final

from swarmware.types.outage import LinkOutage, OutagePhase

WINDOW_S: Final = 600.0
"""Outages that count: those of the last ten minutes."""
UNSTEADY: Final = 3
"""Outages of one link in that time, from which it does not hold: a vehicle that passes by causes one."""


def lost_links(outages: Iterable[LinkOutage], utc_ns: int) -> list[str]:
    """Links that are lost now, each with its time, the longest first."""
    lost = [one for one in outages if one.phase == OutagePhase.LOST]
    lost.sort(key=lambda one: one.began_utc_ns)
    return [f"{one.name} for {max(0, utc_ns - one.began_utc_ns) / 1e9:.0f} s" for one in lost]


def unsteady_links(outages: Iterable[LinkOutage], utc_ns: int) -> list[str]:
    """Links that were lost again and again, each with number and whole length of its outages."""
    recent: dict[str, list[LinkOutage]] = defaultdict(list)
    for one in outages:
        if utc_ns - one.began_utc_ns < WINDOW_S * 1e9:
            recent[one.name].append(one)
    return [
        f"{name}: {len(found)} outages, {sum(one.down_for_s or 0.0 for one in found):.0f} s in all"
        for name, found in sorted(recent.items())
        if len(found) >= UNSTEADY
    ]
