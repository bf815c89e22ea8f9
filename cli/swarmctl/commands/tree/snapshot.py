"""Dumps of the tree, with structure and values, which are written, read and loaded."""

from collections.abc import Container, Iterable
from pathlib import Path
from typing import Any, Final

import msgspec
import tomli_w

from swarmctl.commandline.completion_cache import VALUED
from swarmctl.resources.access import consequence, read_all
from swarmctl.resources.listing import listing
from swarmctl.resources.value_changes import ValueChange, check, set_all
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmctl.terminal.confirmation import confirm
from swarmware.errors import ConfigError, InvalidInput, NotFound
from swarmware.model import document, names
from swarmware.model.resource import Kind
from swarmware.runtime.filewriter import write_result
from swarmware.types.json_form import plain
from swarmware.types.tree import TreeEntry

AT_ONCE: Final = 64
"""Maximum values that are read at the same time."""


class DumpedResource(msgspec.Struct, frozen=True, kw_only=True):
    """A resource with its newest value."""

    path: str
    """Global."""
    kind: str
    type: str = ""
    reply: str = ""
    unit: str = ""
    range: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    access: str = "r"
    rate_hz: float = 0.0
    owner: str = ""
    value: Any = None
    """Value as plain data, or None without a value."""


class TreeSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """Resources of the swarm at one moment."""

    resources: tuple[DumpedResource, ...] = ()
    pattern: str = ""
    """Pattern of the dump, with the platform."""

    @property
    def platforms(self) -> list[str]:
        """Platforms of the resources, in natural order."""
        return sorted({names.split(one.path)[0] or "" for one in self.resources}, key=names.natural)


class LoadedValue(msgspec.Struct, frozen=True):
    """A setting that a file has changed."""

    path: str
    before: Any
    after: Any


class ValuesLoaded(msgspec.Struct, frozen=True):
    """Settings that a file has changed, and the number of settings that already had its values."""

    changed: list[LoadedValue]
    unchanged: int


async def take_snapshot(session: Session, pattern: str, valued: Container[str] = VALUED) -> TreeSnapshot:
    """Resources that match; resources of the kinds `valued` have the values of their owners.

    Raises: NotFound when nothing matches.
    """
    found = await listing(session, pattern)
    paths = [entry.path for entry in found.entries if entry.kind in valued]
    values: dict[str, Any] = {}
    # in portions, since each value may be a request to its owner
    for begin in range(0, len(paths), AT_ONCE):
        readings, _ = await read_all(session, paths[begin : begin + AT_ONCE])
        values |= {reading.path: reading.value for reading in readings}
    resources = tuple(_dumped(entry, values.get(entry.path)) for entry in found.entries)
    return TreeSnapshot(resources=resources, pattern=pattern or "/**")


def _dumped(entry: TreeEntry, value: Any) -> DumpedResource:
    shared = {
        field: getattr(entry, field)
        for field in DumpedResource.__struct_fields__
        if field not in {"kind", "value"}
    }
    return DumpedResource(kind=str(entry.kind), value=value, **shared)


async def dump(session: Session, pattern: str, file: str) -> None:
    """Prints structure and values as TOML, or writes them to a file as TOML, or JSON if its name ends so.

    Raises: NotFound when nothing matches, OSError when the file cannot be written.
    """
    found = await take_snapshot(session, pattern)
    if file:
        target = Path(file)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_result(target, snapshot_bytes(found, as_json=target.suffix == ".json"))
        there = ", ".join(found.platforms)
        session.out.say(f"{target}: {len(found.resources)} resources of {there}")
    if session.settings.structured:
        session.out.document(found)
    elif not file:
        session.out.verbatim(snapshot_bytes(found).decode().rstrip())


def snapshot_bytes(found: TreeSnapshot, *, as_json: bool = False) -> bytes:
    """The content of a dump file."""
    data: dict[str, Any] = plain(found)
    if as_json:
        return msgspec.json.format(msgspec.json.encode(data), indent=2) + b"\n"
    kept = {"pattern": data["pattern"], "resources": [_short(one) for one in data["resources"]]}
    return tomli_w.dumps(kept).encode()


def _short(resource: dict[str, Any]) -> dict[str, Any]:
    """A resource without its empty fields, because TOML has no null."""
    # a value stays even if it is 0 or "", which differs from none
    kept = {key: value for key, value in resource.items() if key == "value" or value not in ("", None, [], 0)}
    if kept.get("access") == "r":
        del kept["access"]
    return {key: _without_null(value) for key, value in kept.items() if value is not None}


def _without_null(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_null(item) for key, item in value.items() if item is not None}
    if isinstance(value, list):
        # an item cannot be left out, since the others would take its place
        return ["" if item is None else _without_null(item) for item in value]
    return value


def read_snapshot(file: str) -> TreeSnapshot:
    """The dump in a file, TOML or JSON.

    Raises: ConfigError naming the file; OSError.
    """
    data = document.read(Path(file))
    try:
        if data.lstrip()[:1] in (b"{", "{"):
            raw = msgspec.json.decode(data)
        else:
            # a measured value may be nan or inf, unlike a setting
            raw = document.toml(data, file, finite=False)
        found = msgspec.convert(raw, TreeSnapshot)
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise ConfigError(f"{file}: not a dump of `swarmctl tree dump`: {error}") from error
    for one in found.resources:
        try:
            names.check_path(one.path)
        except InvalidInput as error:
            raise ConfigError(f"{file}: {error}") from error
        if not one.path.startswith("/"):
            raise ConfigError(f"{file}: {one.path}: expected a global path, such as /uav1/{one.path}")
    return found


async def load(session: Session, file: str, *, yes: bool) -> None:
    """Sets the settings of a dump to its values, all or none, and prints what changed.

    A dump of one platform is loaded at the selected nodes, if some are selected. Boards and commands in the
    dump are left alone, because boards are measurements and a command would move a vehicle.
    Raises: ConfigError for a file that is not a dump, InvalidInput for a value that does not fit or a dump
    without settings, NotFound for a setting that does not exist; as `confirm`, `set_all`.
    """
    # without a selection each value goes to the platform from which it was dumped
    there = await session.selected() if session.settings.node else []
    wanted = _targets(session, read_snapshot(file), file, there)
    entries = await _settings_of(session, wanted)
    if missing := [path for path in wanted if path not in entries]:
        raise NotFound(f"{file}: {', '.join(missing)}: no such setting now; nothing was set")
    # all values before the first is set, so that an invalid file changes nothing
    for path, value in wanted.items():
        check(file, path, entries[path], value)
    # the present values are needed to undo the changes after a refusal
    readings, errors = await read_all(session, list(wanted), fresh=True)
    if errors:
        raise errors[0]
    present = {reading.path: reading.value for reading in readings}
    changed = [
        LoadedValue(path, present[path], value) for path, value in wanted.items() if present[path] != value
    ]
    if changed:
        confirm(yes, await _question(session, file, changed))
    await set_all(session, [ValueChange(one.path, one.before, one.after, one.path) for one in changed])
    if session.settings.structured:
        session.out.document(ValuesLoaded(changed, len(wanted) - len(changed)))
        return
    for one in changed:
        session.out.text(f"{one.path} = {brief(one.after)} (was {brief(one.before)})")
    session.out.say(f"{file}: {len(changed)} settings changed, {len(wanted) - len(changed)} as in the file")


def _targets(session: Session, found: TreeSnapshot, file: str, there: list[str]) -> dict[str, Any]:
    """Path and value of each setting to set, at the platforms `there`, or at its own if that is empty."""
    settings = [one for one in found.resources if one.kind == Kind.SETTING and one.value is not None]
    if not settings:
        raise InvalidInput(f"{file}: has no setting with a value; expected a dump with some")
    if not there:
        return {one.path: one.value for one in settings}
    if len(found.platforms) > 1:
        raise InvalidInput(
            f"{file}: of {', '.join(found.platforms)}; expected one, to load it at {session.settings.node}"
        )
    return {names.join(name, names.split(one.path)[1]): one.value for name in there for one in settings}


async def _settings_of(session: Session, wanted: Iterable[str]) -> dict[str, TreeEntry]:
    """The settings of all platforms of these paths, by path."""
    found: dict[str, TreeEntry] = {}
    for platform in sorted({names.split(path)[0] or "" for path in wanted}, key=names.natural):
        await session.reach(platform)
        entries = (await listing(session, f"/{platform}")).entries
        found |= {entry.path: entry for entry in entries if entry.kind is Kind.SETTING}
    return found


async def _question(session: Session, file: str, changed: list[LoadedValue]) -> str:
    effects = [effect for one in changed if (effect := await consequence(session, one.path))]
    shown = ", ".join(one.path for one in changed[:5]) + (" …" if len(changed) > 5 else "")
    noun = "setting" if len(changed) == 1 else "settings"
    text = f"{file}: sets {len(changed)} {noun}: {shown}"
    return f"{text}: {'; '.join(dict.fromkeys(effects))}" if effects else text
