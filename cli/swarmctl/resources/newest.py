"""The newest value of a resource, as its tree service knows it.

Overviews import this and the types that they show, not what the description of any type needs.
"""

from typing import Final

from swarmctl.session.session import Session
from swarmware.errors import NoAnswer
from swarmware.model.names import join, split
from swarmware.types.tree import Quality, TreeGet, TreeValue, ValueSource

FRESH_S: Final = 1.0
"""Maximum age of a mirror that is used without a query; an older one may be of a rarely changing value, or
its subscription may have ended."""


async def newest(session: Session, path: str, *, fresh: bool = False) -> TreeValue:
    """The newest value; a mirror older than FRESH_S is replaced by the owner's value, if it answers.

    Of a platform without a route it is the last value that the joined node received.
    Raises: NotFound, NoAnswer.
    """
    ask = join(session.here, "sys/tree/get")
    lost = not fresh and not await session.in_reach(split(path)[0] or session.here)
    found = await session.ask(ask, TreeGet(path, fresh), TreeValue, about="" if lost else path)
    if (
        found.source is not ValueSource.MIRROR
        or found.quality is Quality.LOST
        or (found.age_s or FRESH_S) < FRESH_S
    ):
        return found
    try:
        return await session.ask(ask, TreeGet(path, True), TreeValue, about=path)
    except NoAnswer:
        return found
