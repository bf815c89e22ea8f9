"""The settings of a platform as a file: written, loaded all or none, and compared."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import msgspec
import tomli_w

from swarmctl.commands.config.keys import ConfiguredKey, change_command, configured
from swarmctl.resources.access import read_all
from swarmctl.resources.listing import valued
from swarmctl.resources.value_changes import ValueChange, check, set_all
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.errors import Denied, NotFound
from swarmware.model import document, names, paths
from swarmware.runtime.filewriter import write_result
from swarmware.types.config import ConfigOrigin
from swarmware.types.tree import TreeEntry


class LoadedChange(msgspec.Struct, frozen=True):
    """A setting with another value before and after."""

    key: str
    before: Any
    after: Any


class SettingsLoaded(msgspec.Struct, frozen=True):
    """Settings that a file changed."""

    changed: list[LoadedChange]
    platform: str


class SettingDifference(msgspec.Struct, frozen=True):
    """A setting that differs; a side is None if the setting does not exist there."""

    key: str
    here: Any
    there: Any


class SettingsDiff(msgspec.Struct, frozen=True):
    """Differences between the settings of a platform and of a file or another platform."""

    differences: list[SettingDifference]
    platform: str
    other: str
    """File or platform to compare with, or "" for the platform's own files."""


class DumpedSettings(msgspec.Struct, frozen=True):
    """Values of the live settings of a platform, or of all keys, by key."""

    platform: str
    settings: dict[str, Any]


async def dump(session: Session, file: str, *, files: bool = False) -> None:
    """Prints the live settings as TOML, or writes them to a file; `files`: keys of files too.

    Raises: UsageError when several platforms would write one file; as `_values`; OSError when the file
    cannot be written.
    """
    if file and session.joint and not file.endswith("/"):
        raise click.UsageError(f"{file}: one file of several platforms; expected a folder, {file}/")
    values = await _values(session, session.platform, files=files)
    text = tomli_w.dumps({key: value for key, value in values.items() if value is not None})
    if file:
        target = _own_file(session, file)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_result(target, text.encode())
        session.out.say(f"{target}: {len(values)} {'keys' if files else 'settings'} of {session.platform}")
    if session.settings.structured:
        session.out.document(DumpedSettings(session.platform, values))
    elif not file:
        session.out.verbatim(text.rstrip())


async def load(session: Session, file: str, *, yes: bool) -> None:
    """Sets the live settings of a file, all or none, and prints what changed.

    A key of another kind may be in the file with the value in force.
    Raises: ConfigError for a file that is not TOML, NotFound for an unknown key, Denied for another value of
    a key that is read at the start only, InvalidInput for an invalid value, the error of a refused change
    after all others were taken back; as `confirm`.
    """
    wanted = _file(str(_own_file(session, file)))
    present = await _present(session, session.platform)
    # a dump with `--files` has these keys too, and loading it must not fail on equal values
    for key in [key for key in wanted if key not in present]:
        await _check_of_file(session, file, key, wanted.pop(key), present)
    for key, value in wanted.items():
        # all before the first is set: most errors are found without a change to undo
        check(file, key, present[key][0], value)
    changes = [
        LoadedChange(key, present[key][1], value) for key, value in wanted.items() if value != present[key][1]
    ]
    asks = sorted({entry.confirm for key, (entry, _) in present.items() if key in wanted and entry.confirm})
    effect = f"set {', '.join(change.key for change in changes)}: {'; '.join(asks)}"
    await session.confirm(yes, effect if changes and asks else "")
    await set_all(
        session,
        [
            ValueChange(names.join(session.platform, paths.setting(one.key)), one.before, one.after, one.key)
            for one in changes
        ],
    )
    if session.settings.structured:
        session.out.document(SettingsLoaded(changes, session.platform))
        return
    for change in changes:
        session.out.text(f"{change.key} = {brief(change.after)} (was {brief(change.before)})")
    if not changes:
        session.out.say(f"{session.platform}: has these values already")


async def _check_of_file(
    session: Session, file: str, key: str, value: Any, present: Mapping[str, Any]
) -> None:
    try:
        (found, *_) = (await configured(session, key)).settings
    except NotFound as error:
        raise NotFound(
            f"{file}: {key}: no live setting of {session.platform}; expected some of {', '.join(present)}"
        ) from error
    if found.value != value:
        change = change_command(found, session.platform)
        raise Denied(f"{file}: {key}: it is read from a file at the start only: {change}")


async def diff(session: Session, other: str, *, files: bool = False) -> None:
    """Prints what differs from a file or another platform; without one from the platform's files.

    `files`: keys of files too. Raises: as `_values`, ConfigError for a file that is not TOML.
    """
    if not other:
        found = (await configured(session, "**")).settings
        away = [key for key in found if key.origin == ConfigOrigin.LIVE or key.pending]
        differences = [SettingDifference(key.key, key.value, _reference(key)) for key in away]
    else:
        here = await _values(session, session.platform, files=files)
        there = _file(other) if _is_file(other) else await _values(session, other, files=files)
        differences = [
            SettingDifference(key, here.get(key), there.get(key))
            for key in dict.fromkeys([*here, *there])
            if here.get(key) != there.get(key)
        ]
    _print_differences(session, differences, other)


def _reference(key: ConfiguredKey) -> Any:
    """The value of the file; of a setting without one the default."""
    return key.file_value if key.service else key.default


def _print_differences(session: Session, differences: list[SettingDifference], other: str) -> None:
    if session.settings.structured:
        session.out.document(SettingsDiff(differences, session.platform, other))
        return
    columns = [Column("KEY"), Column(session.platform, right=True), Column(other or "FILE", right=True)]
    rows = [(one.key, _cell(one.here), _cell(one.there)) for one in differences]
    same = f"same settings as {other}" if other else "the values of its files are in force"
    session.out.table(columns, rows, empty=f"{session.platform}: {same}")


async def _present(session: Session, platform: str) -> dict[str, tuple[TreeEntry, Any]]:
    """The live settings of a platform with their values, by key.

    Raises: NotFound for a platform without any, NoAnswer.
    """
    await session.reach(platform)
    prefix = names.join(platform, paths.setting(""))
    try:
        entries = await valued(session, f"{prefix}**")
    except NotFound as error:
        raise NotFound(f"{platform}: has no live settings; expected a vehicle") from error
    # from the owner, as a mirror may have the value before the last change
    readings, errors = await read_all(session, [entry.path for entry in entries], fresh=True)
    # a missing value would count as a difference, and be lost in a dump
    if errors:
        raise errors[0]
    values = {reading.path: reading.value for reading in readings}
    return {entry.path.removeprefix(prefix): (entry, values[entry.path]) for entry in entries}


def _own_file(session: Session, file: str) -> Path:
    """The file, or the platform's file in a folder, which ends in a slash."""
    return paths.platform_settings(Path(file), session.platform) if file.endswith("/") else Path(file)


async def _values(session: Session, platform: str, *, files: bool) -> dict[str, Any]:
    """The values in force of the live settings, or of every key, by key.

    Raises: as `_present`.
    """
    if not files:
        return {key: value for key, (_, value) in (await _present(session, platform)).items()}
    return {key.key: key.value for key in (await configured(session, "**", platform=platform)).settings}


def _file(file: str) -> dict[str, Any]:
    return document.toml(document.read(Path(file)), file)


def _is_file(name: str) -> bool:
    return Path(name).is_file()


def _cell(value: Any) -> str | None:
    return None if value is None else brief(value)
