"""Selection of vehicles: by name, by pattern, or all."""

from collections.abc import Iterable, Mapping

import click

from swarmctl.commandline.nodes import EVERY, NodeSelection, joined
from swarmctl.session.session import Session
from swarmware.errors import InvalidInput, NotFound
from swarmware.model.platform_kind import NO_KIND, PlatformKind
from swarmware.types.mission import INACTIVE, MissionState


def mission_states(session: Session) -> dict[str, MissionState]:
    """Newest mission state of every platform, including unreachable ones."""
    others = session.module.readers("/*/mission/state", MissionState)
    own = session.module.reader("mission/state", MissionState)
    found = {name: reader.value for name, reader in others.items()} | {session.here: own.value}
    return {name: state for name, state in found.items() if state is not None}


async def kinds(session: Session) -> dict[str, PlatformKind]:
    """Kinds of all known platforms, including unreachable ones; "" until it is received."""
    boards = session.module.readers("/*/mission/state", MissionState)
    found = {}
    for name in await session.platforms():
        state = boards[name].value if name in boards else None
        found[name] = (
            session.module.node.config.kind if name == session.here else state.kind if state else NO_KIND
        )
    return found


def stations_left(
    states: Mapping[str, MissionState], kinds: Mapping[str, PlatformKind], chosen: Iterable[str]
) -> dict[str, PlatformKind]:
    """Ground stations whose mission runs at no other vehicle than the chosen ones.

    An order to these vehicles ends the mission; a station would wait at its next barrier, and fail there.
    """
    running = {name: state for name, state in states.items() if state.epoch and state.state not in INACTIVE}
    stations = {name for name in running if kinds.get(name) == PlatformKind.GCS}
    found = {}
    for station in stations:
        epoch = running[station].epoch
        # a mission of stations alone has no vehicles, and an order to vehicles does not end it
        vehicles = {name for name, state in running.items() if state.epoch == epoch} - stations
        if vehicles and vehicles <= set(chosen):
            found[station] = kinds[station]
    return found


async def is_station(session: Session, platform: str) -> bool:
    """Whether a platform is known to be a ground station."""
    return (await kinds(session)).get(platform) == PlatformKind.GCS


async def choose(session: Session, wanted: Iterable[str]) -> dict[str, PlatformKind]:
    """The selected vehicles in natural order, with their kinds; without names those that `-n` selects.

    Raises: UsageError when none was named, NotFound when nothing matches, InvalidInput for a ground station.
    """
    words = joined(wanted)
    if words and session.settings.node == EVERY:
        raise click.UsageError("names of platforms and --all: expected one of them")
    words = words or session.settings.node
    if not words:
        raise click.UsageError("expected names of platforms, or --all")
    selection = NodeSelection(words)
    known = await kinds(session)
    moving = {name: kind for name, kind in known.items() if kind != PlatformKind.GCS}
    there = ", ".join(moving) or "none"
    if not moving:
        raise NotFound(f"no vehicle is known to {session.here}; expected at least one")
    # from all platforms, so that the name of a station gets its own error
    chosen = selection.choose(known, session.here)
    if not any(name in moving for name in chosen):
        raise InvalidInput(f"{', '.join(chosen)}: a ground station; expected a vehicle: {there}")
    return {name: moving[name] for name in chosen if name in moving}
