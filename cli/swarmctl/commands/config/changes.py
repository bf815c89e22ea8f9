"""Changes of live settings by an operator, and their history."""

from typing import Any

import msgspec

from swarmctl.commands.config.keys import ConfiguredKey, change_command, configured, unpacked
from swarmctl.resources.access import consequence, reset, set_resource
from swarmctl.resources.listing import is_pattern
from swarmctl.resources.undoing import undo_resource
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import utc_text
from swarmctl.terminal.table import Column
from swarmware.errors import Denied, InvalidInput, NotFound
from swarmware.model import names, paths
from swarmware.types.config import ConfigHistory, HistoryQuery


class HistoryEntry(msgspec.Struct, frozen=True):
    """One change of a live setting."""

    key: str
    utc_ns: int
    """Wall clock of the platform."""
    by: str
    """`role@platform` of the requester, or `application@platform` on the platform itself."""
    before: Any
    after: Any
    before_origin: str
    """live; file: the value of the file, or the default, was in force."""
    after_origin: str


class SettingHistory(msgspec.Struct, frozen=True):
    """Changes of a platform's live settings, the newest first."""

    changes: list[HistoryEntry]
    platform: str


async def set_setting(session: Session, key: str, value: str, *, yes: bool) -> None:
    """Sets a live setting and prints the value in force.

    Raises: Denied for a key of a file, with file, key and command; NotFound; as `set_resource`.
    """
    _check_one(key)
    try:
        await set_resource(session, paths.setting(key), value, version=None, yes=yes)
    except (NotFound, InvalidInput):
        name = await _live_name(session, key)
        if name == key:
            raise  # the value is wrong, not the key
        await set_resource(session, paths.setting(name), value, version=None, yes=yes)


def _check_one(key: str) -> None:
    if is_pattern(key):
        raise InvalidInput(f"key {key!r}: a pattern; expected one key")


async def _live_name(session: Session, key: str) -> str:
    """Name of the live setting of a key, which may be given by its place in the file.

    Raises: Denied for a key without a live setting, NotFound.
    """
    found: ConfiguredKey = (await configured(session, key)).settings[0]
    if not found.live:
        change = change_command(found, session.platform)
        raise Denied(f"{session.platform}: {found.key} is read from a file at the start only: {change}")
    return found.key


async def reset_setting(session: Session, key: str, *, yes: bool) -> None:
    """Removes the override of a setting: the value of its file is in force, else the default.

    Raises: Denied for a key of a file, NotFound; NoAnswer when a service has not taken it; as `confirm`.
    """
    _check_one(key)
    name = await _live_name(session, key)
    path = session.path(paths.setting(name))
    will = "" if yes else await consequence(session, path)
    await session.confirm(yes, will and f"reset {paths.setting(name)}: {will}")
    done = await reset(session, path)
    if session.settings.structured:
        session.out.document(done)
    else:
        now = (await configured(session, name)).settings[0]
        session.out.text(f"{done.path} = {brief(done.value)} ({done.details}; {now.source})")
    done.check_applied()


async def undo_setting(session: Session, key: str, *, yes: bool) -> None:
    """Takes back the last change of a setting and prints both values; `yes`: asks nothing.

    Raises: NotFound when it was not changed, Denied for a key of a file; as `confirm`.
    """
    _check_one(key)
    try:
        await undo_resource(session, paths.setting(key), yes=yes)
    except (NotFound, InvalidInput):
        name = await _live_name(session, key)
        if name == key:
            raise  # it was not changed
        await undo_resource(session, paths.setting(name), yes=yes)


async def print_history(session: Session, pattern: str) -> None:
    """Prints who changed which setting, from what to what, the newest first.

    Raises: NoAnswer; NotFound for an unknown platform or key.
    """
    await session.reach(session.platform)
    path = names.join(session.platform, "sys/tree/history")
    found = await session.ask(path, HistoryQuery(pattern), ConfigHistory)
    # settings are kept by the computer of their service, which is rarely another one
    for other in () if found.changes else await session.other_computers(session.platform):
        found = await session.ask(names.join(other, "sys/tree/history"), HistoryQuery(pattern), ConfigHistory)
        if found.changes:
            break
    if not found.changes:
        await configured(session, pattern)  # an unknown key is an error
    entries = [
        HistoryEntry(
            one.name,
            one.utc_ns,
            one.by,
            unpacked(one.before),
            unpacked(one.after),
            "live" if one.overrode else "file",
            "live" if one.overrides else "file",
        )
        for one in found.changes
    ]
    if session.settings.structured:
        session.out.document(SettingHistory(entries, found.platform))
        return
    columns = [Column("AT"), Column("KEY"), Column("BEFORE"), Column("AFTER"), Column("BY")]
    rows = [
        (
            utc_text(one.utc_ns),
            one.key,
            _with_origin(one.before, one.before_origin),
            _with_origin(one.after, one.after_origin),
            one.by,
        )
        for one in entries
    ]
    session.out.table(columns, rows, empty=f"{found.platform}: no live setting was changed")


def _with_origin(value: Any, origin: str) -> str:
    return brief(value) if origin == "live" else f"{brief(value)} (file)"
