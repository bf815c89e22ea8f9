"""Readiness of vehicles: whether each may be armed, and what is not ready."""

import asyncio
from typing import Final

import msgspec

from swarmctl.commandline.nodes import names_one
from swarmctl.resources.fanout import warn_errors
from swarmctl.resources.newest import newest
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmctl.vehicles.selection import kinds
from swarmware.errors import InvalidInput, NotFound, Partial, SwarmError
from swarmware.model import names
from swarmware.model.platform_kind import PlatformKind
from swarmware.types import registry
from swarmware.types.health import NotReady, Readiness
from swarmware.types.tree import Quality, TreeValue

PATH: Final = "health/ready"
FRESH_S: Final = 3.0
"""Age above which a readiness is unknown: it is published once a second."""


class VehicleReadiness(msgspec.Struct, frozen=True):
    """Readiness of one vehicle."""

    platform: str
    ready: bool | None
    """Whether it is ready, or None without an answer or a published readiness."""
    not_ready: tuple[NotReady, ...] = ()
    """Items that are not ready, each with its reason."""
    items: tuple[str, ...] = ()
    """Items that apply to this vehicle."""
    warnings: tuple[NotReady, ...] = ()
    """Items that an operator should act on, each with its reason; they do not refuse."""


class ReadinessList(msgspec.Struct, frozen=True):
    """Readiness of the selected vehicles."""

    vehicles: list[VehicleReadiness]


async def show_readiness(session: Session) -> None:
    """Prints the readiness of the selected vehicles, else of all.

    Raises: SwarmError when none is ready, Partial when some are not; InvalidInput for a ground station alone,
    NotFound without vehicles; the error itself when one vehicle was named and did not answer.
    """
    selected = await session.selected()
    known = await kinds(session)
    asked = [name for name in selected if known.get(name) != PlatformKind.GCS]
    if not asked and session.settings.node:
        raise InvalidInput(f"{', '.join(selected)}: a ground station; expected a vehicle")
    if not asked:
        raise NotFound(f"no vehicle is known to {session.here}; expected at least one")
    found = await asyncio.gather(*(_readiness(session, name) for name in asked))
    errors = {name: one for name, one in zip(asked, found, strict=True) if isinstance(one, SwarmError)}
    if names_one(session.settings.node):
        for error in errors.values():
            raise error
    rows = [_row(name, one) for name, one in zip(asked, found, strict=True)]
    if session.settings.structured:
        session.out.document(ReadinessList(rows))
    else:
        session.out.table(
            [Column("PLATFORM"), Column("READY"), Column("ITEM"), Column("REASON")],
            [line for row in rows for line in _lines(row)],
        )
    warn_errors(session, errors)
    _raise_unready(rows)


async def _readiness(session: Session, platform: str) -> TreeValue | SwarmError | None:
    """The newest value, the error of a platform that does not answer, or None of one without a value."""
    try:
        await session.reach(platform)
    except SwarmError as error:
        return error
    try:
        return await newest(session, names.join(platform, PATH))
    # the platform has no monitor, which is a different result from no answer
    except NotFound:
        return None
    except SwarmError as error:
        return error


def _row(platform: str, found: TreeValue | SwarmError | None) -> VehicleReadiness:
    if isinstance(found, SwarmError):
        return VehicleReadiness(platform, None)
    if found is None:
        absent = NotReady("health", f"no {PATH}; expected it of the service health")
        return VehicleReadiness(platform, None, (absent,))
    value = registry.decode(Readiness, found.data)
    # a stale `ready` must not permit arming: its monitor may have ended
    old = found.age_s is not None and found.age_s > FRESH_S
    if old or found.quality is Quality.LOST:
        stale = NotReady("health", f"no {PATH} for {found.age_s or 0.0:.0f} s")
        return VehicleReadiness(platform, None, (stale,), value.items)
    return VehicleReadiness(platform, value.ready, value.not_ready, value.items, value.warnings)


def _lines(row: VehicleReadiness) -> list[tuple[str, str, str, str]]:
    """One line for each item that is not ready, or one with all that were checked; then the warnings."""
    warned = [(row.platform, "warning", one.item, one.reason) for one in row.warnings]
    if row.ready:
        return [(row.platform, "yes", "", ", ".join(row.items)), *warned]
    word = "unknown" if row.ready is None else "no"
    unready = [(row.platform, word, one.item, one.reason) for one in row.not_ready]
    return [*(unready or [(row.platform, "silent", "", "")]), *warned]


def _raise_unready(rows: list[VehicleReadiness]) -> None:
    bad = [row.platform for row in rows if not row.ready]
    if bad:
        text = f"not ready: {', '.join(bad)}"
        raise SwarmError(text) if len(bad) == len(rows) else Partial(text)
