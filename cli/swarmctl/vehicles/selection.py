"""Selection of vehicles: by name, by pattern, or all."""

from collections.abc import Iterable

import click

from swarmctl.resources.fanout import platforms
from swarmctl.resources.listing import is_pattern
from swarmctl.session.session import Session
from swarmware.errors import InvalidInput, NotFound
from swarmware.model import names
from swarmware.model.names import Pattern
from swarmware.model.platform_kind import NO_KIND, PlatformKind
from swarmware.types.mission import MissionState


async def kinds(session: Session) -> dict[str, PlatformKind]:
    """Kinds of all known platforms, including unreachable ones; empty: not received yet."""
    boards = session.module.readers("/*/mission/state", MissionState)
    found = {}
    for name in await platforms(session):
        state = boards[name].value if name in boards else None
        found[name] = (
            session.module.node.config.kind if name == session.here else state.kind if state else NO_KIND
        )
    return found


async def is_station(session: Session, platform: str) -> bool:
    """Whether a platform is known to be a ground station."""
    return (await kinds(session)).get(platform) == PlatformKind.GCS


async def choose(
    session: Session, wanted: Iterable[str], *, everything: bool = False
) -> dict[str, PlatformKind]:
    """The selected vehicles in natural order, with their kinds; `-n` selects one as well.

    Raises: UsageError when none was named, NotFound when nothing matches, InvalidInput for a ground station.
    """
    words = list(wanted) or ([session.settings.node] if session.settings.node else [])
    if everything == bool(words):
        raise click.UsageError("expected names of platforms, or --all")
    known = await kinds(session)
    moving = {name: kind for name, kind in known.items() if kind != PlatformKind.GCS}
    there = ", ".join(moving) or "none"
    chosen: set[str] = set(moving) if everything else set()
    for word in words:
        matcher = Pattern(word)
        found = {name for name in moving if matcher.matches(name)}
        if not found and not is_pattern(word) and word in known:
            raise InvalidInput(f"{word}: a ground station; expected a vehicle: {there}")
        if not found:
            raise NotFound(f"{word}: no vehicle matches; known to {session.here}: {there}")
        chosen |= found
    if not chosen:
        raise NotFound(f"no vehicle is known to {session.here}; expected at least one")
    return {name: moving[name] for name in sorted(chosen, key=names.natural)}
