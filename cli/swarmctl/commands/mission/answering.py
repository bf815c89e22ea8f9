"""The operator's answer to a mission that waits at a UserBreakpoint."""

import msgspec

from swarmctl.session.session import Session
from swarmware.types.mission import BreakpointAnswer
from swarmware.types.rpc import Empty


class MissionAnswer(msgspec.Struct, frozen=True):
    """Answer that a platform has received."""

    platform: str
    proceed: bool
    """Whether the mission continues."""
    block: str = ""
    """Name of the block, or "" if a single block asked."""


async def answer(session: Session, block: str, *, proceed: bool) -> None:
    """Answers the question of a block, and prints the answer.

    Raises: NotFound when no block asks, Conflict when several do and none is named.
    """
    await session.ask("sys/mission/answer", BreakpointAnswer(proceed, block), Empty)
    if session.settings.structured:
        session.out.document(MissionAnswer(session.platform, proceed, block))
    else:
        session.out.say(f"{session.platform}: {'continues' if proceed else 'stops'}")
