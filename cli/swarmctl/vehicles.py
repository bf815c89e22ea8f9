"""Vehicles as an operator names them: by name, by pattern, or all of them."""

from collections.abc import Iterable
from typing import Final

import click

from swarmctl.connect import Link
from swarmctl.listing import is_pattern
from swarmctl.survey import platforms
from swarmware import names
from swarmware.errors import InvalidInput, NotFound
from swarmware.names import Pattern
from swarmware.types.mission import MissionState

STATION: Final = "gcs"


async def kinds(link: Link) -> dict[str, str]:
    """Every platform that is known, also those that are away, and its kind; empty: never heard."""
    boards = await link.module.readers("/*/mission/state", MissionState)
    found = {}
    for name in await platforms(link):
        state = boards[name].value if name in boards else None
        found[name] = link.module.node.config.kind if name == link.here else state.kind if state else ""
    return found


async def is_station(link: Link, platform: str) -> bool:
    """Whether it is known to be a ground station."""
    return (await kinds(link)).get(platform) == STATION


async def choose(link: Link, wanted: Iterable[str], *, everything: bool = False) -> dict[str, str]:
    """The vehicles that are meant, in natural order, with their kinds; `-n` names one as well.

    Raises: UsageError when none was named, NotFound when nothing matches, InvalidInput for a ground station.
    """
    words = list(wanted) or ([link.settings.node] if link.settings.node else [])
    if everything == bool(words):
        raise click.UsageError("expected the platforms that are meant, or --all")
    known = await kinds(link)
    moving = {name: kind for name, kind in known.items() if kind != STATION}
    there = ", ".join(moving) or "none"
    chosen: set[str] = set(moving) if everything else set()
    for word in words:
        matcher = Pattern(word)
        found = {name for name in moving if matcher.matches(name)}
        if not found and not is_pattern(word) and word in known:
            raise InvalidInput(f"{word}: a ground station; expected a vehicle: {there}")
        if not found:
            raise NotFound(f"{word}: no vehicle matches; known to {link.here}: {there}")
        chosen |= found
    if not chosen:
        raise NotFound(f"no vehicle is known to {link.here}; expected at least one")
    return {name: moving[name] for name in sorted(chosen, key=names.natural)}
