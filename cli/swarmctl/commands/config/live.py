"""Live settings of a platform: the resources below `config/`."""

from typing import Any

import msgspec

from swarmctl.resources.access import read, read_all, undo
from swarmctl.resources.listing import consequence, is_pattern, valued
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmctl.terminal.output import Column
from swarmware.errors import NotFound
from swarmware.model import paths


class LiveSetting(msgspec.Struct, frozen=True):
    """A setting that is changed while the node runs."""

    path: str
    value: Any
    unit: str
    range: tuple[float, float] | None
    """Smallest and largest accepted value."""
    version: int


class LiveSettings(msgspec.Struct, frozen=True):
    """Settings of a platform."""

    settings: list[LiveSetting]


class SettingUndone(msgspec.Struct, frozen=True):
    """A setting whose last change was undone."""

    path: str
    before: Any
    value: Any
    version: int


async def print_settings(session: Session, key: str) -> None:
    """Prints one setting, or all that match with unit, range and version.

    Raises: NotFound when none matches.
    """
    await session.reach(session.platform)
    try:
        entries = await valued(session, paths.setting(key))
    except NotFound as error:
        if is_pattern(key):
            raise NotFound(f"{session.platform}: no live setting matches {key!r}") from error
        raise
    readings, errors = await read_all(session, [entry.path for entry in entries])
    if errors:
        raise errors[0]
    limits = {entry.path: entry.range for entry in entries}
    if session.settings.structured:
        found = [LiveSetting(r.path, r.value, r.unit, limits[r.path], r.version) for r in readings]
        session.out.document(LiveSettings(found))
    elif not is_pattern(key):
        session.out.text(brief(readings[0].value))
    else:
        rows = []
        for r in readings:
            limit = limits[r.path]
            shown = f"{limit[0]:g}..{limit[1]:g}" if limit else None
            rows.append((r.path, brief(r.value), r.unit, shown, r.version))
        columns = [Column("PATH"), Column("VALUE"), Column("UNIT"), Column("RANGE"), Column("VERSION")]
        session.out.table(columns, rows)


async def undo_setting(session: Session, key: str, *, yes: bool) -> None:
    """Takes back the last change of a setting and prints both values; `yes`: asks nothing.

    Raises: NotFound when it was not changed; as `confirm`.
    """
    path = session.path(paths.setting(key))
    will = "" if yes else await consequence(session, path)
    await session.confirm(yes, will and f"undo the last change of {paths.setting(key)}: {will}")
    before = await read(session, path, fresh=True)
    done = await undo(session, path)
    if session.settings.structured:
        session.out.document(SettingUndone(done.path, before.value, done.value, done.version))
    else:
        was, now = brief(before.value), brief(done.value)
        session.out.text(f"{done.path} = {now} (version {done.version}; was {was})")
