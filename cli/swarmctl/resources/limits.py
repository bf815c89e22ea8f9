"""Reasons why fewer values arrive than their owner writes."""

from typing import Final

from swarmctl.resources.newest import newest
from swarmctl.resources.rate_meter import RateMeter
from swarmctl.resources.subscription import ORDERED
from swarmctl.session.session import Session
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.types import registry
from swarmware.types.channel import ChannelLimit, ChannelLimits
from swarmware.types.tree import TreeEntry

MISSION_STATE: Final = "mission/state"
"""Board whose rate a mission needs: its barriers wait for it."""

LOSSES: Final = "tree/losses"

_BY_LINK = {
    "tick": "the beacon carries the newest value only",
    "notify": "notifications carry the newest value only",
    "request": "it is sent on request only",
}


async def limit_of(session: Session, path: str) -> ChannelLimit | None:
    """Rule that limits the rate of a resource on its way here, or None if no rule is known to."""
    platform, local = names.split(path)
    try:
        found = await newest(session, names.join(platform or session.here, "net/limits"))
        limits = registry.decode(ChannelLimits, found.data).limits
    except SwarmError:
        return None  # without a broker there is no limit
    here = session.here
    return next((one for one in limits if one.settings.max_hz is not None and one.matches(local, here)), None)


async def thinning(session: Session, entry: TreeEntry, meter: RateMeter) -> str:
    """Sentence about a resource that arrives less often than it is written, with the reason."""
    written_hz, here_hz = meter.written_hz or 0.0, meter.here_hz or 0.0
    limit = await limit_of(session, entry.path)
    # the order is from certain to assumed: a rule explains the loss exactly, the kind of link only roughly
    if names.split(entry.path)[0] == session.here:
        reason = "they were replaced before they were read"
    elif limit is not None and limit.settings.adaptive:
        reason = f"its rate follows the link by {limit.pattern!r}; `swarmctl traffic channels` shows it"
    elif limit is not None:
        reason = f"limit {limit.settings.max_hz:g} Hz of {limit.pattern!r}; `swarmctl traffic set` changes it"
    elif entry.kind in ORDERED:
        losses = names.join(names.split(entry.path)[0] or session.here, LOSSES)
        reason = f"its link carries fewer; items wait in order, and {losses} counts those that were lost"
    else:
        reason = _BY_LINK.get(entry.link, "its link carries fewer values")
    return f"{entry.path}: written at {written_hz:.1f} Hz, arrives here at {here_hz:.1f} Hz: {reason}"
