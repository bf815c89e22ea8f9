"""The newest value of a resource, as its tree service knows it.

Overviews import this and the types that they show, not what the description of any type needs.
"""

from typing import Final

import msgspec

from swarmctl.session.session import Session
from swarmware.errors import NoAnswer, NotFound
from swarmware.model.names import join, split
from swarmware.types.tree import Quality, TreeGet, TreeValue, ValueSource

FRESH_S: Final = 1.0
"""Maximum age of a mirror that is used without a query; an older one may be of a rarely changing value, or
its subscription may have ended."""


async def newest(session: Session, path: str, *, fresh: bool = False) -> TreeValue:
    """The newest value: the copy at the joined node if it is young enough, else the owner's value.

    For a platform without a route the last value that the joined node received is returned.
    Raises: NotFound, NoAnswer.
    """
    platform = split(path)[0] or session.here
    if fresh or platform == session.here:
        return await owned(session, path)
    reachable = await session.in_reach(platform)
    copy = None
    # the mirror first, because it costs no traffic between the nodes
    try:
        ask = join(session.here, "sys/tree/get")
        copy = await session.ask(ask, TreeGet(path), TreeValue, about=path if reachable else "")
    except NotFound:
        if not reachable:
            raise
    if copy is not None and (not reachable or _is_young(copy)):
        return copy
    try:
        return await owned(session, path)
    except NoAnswer:
        # a stale copy with its age shown is better than an error
        if copy is None:
            raise
        return copy


def _is_young(copy: TreeValue) -> bool:
    """Whether a copy is used without a query to its owner."""
    # an owner that has ended can no longer be asked, so its last value is as good as it gets
    if copy.quality is Quality.LOST:
        return True
    return copy.quality is Quality.LIVE and copy.age_s is not None and copy.age_s < FRESH_S


async def owned(session: Session, path: str) -> TreeValue:
    """The newest value at its owner, which is asked directly.

    Raises: NotFound, NoAnswer, Denied.
    """
    platform = split(path)[0] or session.here
    found = await session.ask(join(platform, "sys/tree/get"), TreeGet(path), TreeValue, about=path)
    if platform == session.here:
        return found
    age_s = session.age_s(platform, found.stamp_ns)
    return msgspec.structs.replace(
        found, source=ValueSource.ASKED, age_s=found.age_s if age_s is None else age_s
    )
