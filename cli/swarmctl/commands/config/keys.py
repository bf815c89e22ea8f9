"""Keys of a node's configuration: values in force, their origin and their description."""

import re
from pathlib import Path, PurePosixPath
from typing import Any, Final

import msgspec

from swarmctl.commandline import completion_cache, word_cache
from swarmctl.commandline.nodes import is_selection
from swarmctl.commandline.settings import CliSettings
from swarmctl.resources.listing import is_pattern
from swarmctl.resources.values import brief
from swarmctl.session.session import Session, config_dir, local_config_dirs
from swarmctl.terminal.node_output import NodeOutput, print_results, raise_errors
from swarmctl.terminal.output import Output
from swarmctl.terminal.quantities import utc_text
from swarmctl.terminal.table import Detail, rows_of
from swarmware.errors import ConfigError, NotFound, SwarmError
from swarmware.model import names, paths, template
from swarmware.model.config import load_node
from swarmware.model.names import similar
from swarmware.model.resource import Kind
from swarmware.model.stored_setting import FILE, LiveValue, read_settings
from swarmware.types.config import ConfigKey, ConfigOrigin, ConfigQuery, EffectiveConfig
from swarmware.types.units import unit_suffix

_LISTED: Final = re.compile(r"[\w.-]+(, [\w.-]+)+")
"""Permitted values that are listed: no interval, and no pattern."""


class ConfiguredKey(msgspec.Struct, frozen=True):
    """One key of the configuration with the value in force."""

    key: str
    """`broker/tick_hz`: service and key; of a key that a live setting overrides the name of the setting."""
    value: Any
    """Value in force, or the value at the next start of a service that does not run."""
    origin: str
    """default | file | live."""
    type: str
    unit: str
    default: Any
    """Built-in default, or the first value of a live setting."""
    limits: str
    """Permitted values, or () for all values of the type."""
    live: bool
    """Changes take effect at once; else the file is changed, and the service restarted."""
    path: str
    """Path of the live setting in the tree, or "" for a key that needs a restart."""
    service: str
    """Service that reads the file, `node` for node.toml, or "" for a setting without a file."""
    file: str
    file_key: str
    """Key in the file."""
    line: int
    """Line in the file, or 0 if the file does not have the key."""
    file_value: Any
    """Value by the present file, or null without a valid file."""
    pending: bool
    """The file was changed since the service has read it: `file_value` needs a restart."""
    running: bool
    """Whether the service runs."""
    version: int
    """Number of changes of a live setting."""
    changed_by: str
    """Requester of the last change of a live setting."""
    changed_utc_ns: int
    """Wall clock of the platform at the last change, or 0 if it was never changed."""
    meaning: str

    @property
    def range(self) -> str:
        """Text of the permitted values, without a minus sign that no keyboard has."""
        return self.limits.replace("−", "-")

    @property
    def source(self) -> str:
        """Text of the origin, with the value of the file where another one is in force."""
        place = f"{PurePosixPath(self.file).name}:{self.line}" if self.line else self.origin
        if self.origin == ConfigOrigin.LIVE:
            return f"live (file: {brief(self.file_value)})" if self.service else "live"
        if self.pending:
            return f"{self.origin} (file: {brief(self.file_value)}, needs a restart)"
        return place if self.origin == ConfigOrigin.FILE else self.origin


class ConfiguredKeys(msgspec.Struct, frozen=True):
    """Keys of a node's configuration."""

    settings: list[ConfiguredKey]
    platform: str
    problems: list[str]
    """Files that are invalid now: the next start of their services fails."""


async def configured(
    session: Session, pattern: str, *, platform: str = "", meanings: bool = False
) -> ConfiguredKeys:
    """The keys of a platform that match, as it answers itself.

    Raises: NotFound when none matches, with a similar one; NoAnswer.
    """
    platform = names.check_computer(platform or session.platform)
    await session.reach(platform)
    path = names.join(platform, "sys/node/config")
    found = await session.ask(path, ConfigQuery(pattern, meanings), EffectiveConfig)
    if not found.keys:
        # a service may run on another computer of the platform
        for other in await session.other_computers(platform):
            there = names.join(other, "sys/node/config")
            found = await session.ask(there, ConfigQuery(pattern, meanings), EffectiveConfig)
            if found.keys:
                break
    if not found.keys:
        everything = await session.ask(path, ConfigQuery(), EffectiveConfig)
        known = [key.name for key in everything.keys]
        near = similar(pattern, known)
        hint = f"did you mean {near[0]}?" if near else "`swarmctl config get` lists the keys"
        verb = "matches" if is_pattern(pattern) else "has the name"
        raise NotFound(f"{platform}: no key of the configuration {verb} {pattern!r}; {hint}")
    shown = _shown(found)
    way = str(config_dir(session.settings))
    # a partial answer would remove the other keys from the completion
    if pattern == "**":
        completion_cache.save_keys(way, platform, ((key.name, key.live) for key in found.keys))
    _remember_values(way, platform, [key for key in shown.settings if key.live])
    return shown


def _remember_values(way: str, platform: str, keys: list[ConfiguredKey]) -> None:
    """Stores values of live settings for completion: all, or the present one and the default."""
    values: dict[str, word_cache.FieldValues] = {}
    hints: dict[str, str] = {}
    for key in keys:
        path = names.join(platform, paths.setting(key.key))
        listed = isinstance(key.value, str | bool) and _LISTED.fullmatch(key.range)
        known = key.range.split(", ") if listed else dict.fromkeys([brief(key.value), brief(key.default)])
        values[path] = {"value": list(known)}
        unit = unit_suffix(key.unit)
        allowed = f"{key.range}{unit}, " if key.range and not listed else ""
        hints[path] = f"{allowed}default {brief(key.default)}{unit}"
    if values:
        word_cache.save(way, fields=values, hints=hints)


def local_keys(folder: Path, pattern: str = "**") -> ConfiguredKeys:
    """The keys of a node by its files and stored live settings; the node need not run.

    Raises: ConfigError for an invalid file, NotFound when none matches.
    """
    from swarmware.service.effective import effective_config

    node = load_node(folder)
    live: dict[str, LiveValue] = {}
    for resource in template.load(node.template, node.share_path / "templates").resources:
        if resource.kind is Kind.SETTING:
            live[resource.path] = LiveValue(resource, None, None)
    try:
        stored = read_settings(node.data_path / FILE)
    except FileNotFoundError:
        stored = {}
    for path, kept in stored.items():
        # a stored value may be of a setting that the template no longer has
        if path in live:
            live[path] = LiveValue(live[path].resource, kept.value, kept)
    found = effective_config(folder, {}, live, pattern)
    if found.problems:
        raise ConfigError("; ".join(found.problems))
    if not found.keys:
        services = ", ".join(("node", *node.services))
        raise NotFound(f"no key of the configuration matches {pattern!r}; expected keys of {services}")
    return _shown(found)


def _shown(found: EffectiveConfig) -> ConfiguredKeys:
    platform = found.platform
    return ConfiguredKeys([_key(platform, key) for key in found.keys], platform, list(found.problems))


def _key(platform: str, key: ConfigKey) -> ConfiguredKey:
    return ConfiguredKey(
        key=key.name,
        value=unpacked(key.value),
        origin=key.origin,
        type=key.type,
        unit=key.unit,
        default=unpacked(key.default),
        limits=key.limits,
        live=key.live,
        path=names.join(platform, paths.setting(key.name)) if key.live else "",
        service=key.service,
        file=key.file,
        file_key=key.key,
        line=key.line,
        file_value=unpacked(key.file_value),
        pending=key.pending,
        running=key.running,
        version=key.version,
        changed_by=key.by,
        changed_utc_ns=key.utc_ns,
        meaning=key.meaning,
    )


def unpacked(data: bytes) -> Any:
    """A plain value; None for none."""
    return msgspec.msgpack.decode(data) if data else None


async def print_keys(session: Session, pattern: str, *, changed: bool) -> None:
    """Prints one value, or all keys that match with unit and origin; `changed`: only without their default.

    Raises: as `configured`.
    """
    found = await configured(session, pattern)
    # the bare value, so that a script can use it
    if not is_pattern(pattern) and not session.settings.structured and session.settings.output != "wide":
        _warn(session.out, found)
        session.out.text(brief(found.settings[0].value))
        return
    print_table(session.out, found, changed=changed)


def print_local(settings: CliSettings, wanted: str, out: Output, *, changed: bool) -> None:
    """Prints the keys of nodes whose files are on this machine.

    Raises: as `local_keys` and `local_config_dirs`, Partial when it failed at some nodes.
    """
    pattern = wanted if not wanted or "/" in wanted or is_pattern(wanted) else f"{names.segment(wanted)}/*"
    folders = local_config_dirs(settings)
    several = is_selection(settings.node)
    outputs = {name: NodeOutput(name, out) for name in folders}
    errors: dict[str, SwarmError] = {}
    for name, folder in folders.items():
        try:
            found = local_keys(folder, pattern or "**")
            print_table(outputs[name] if several else out, found, changed=changed)
        except SwarmError as error:
            if not several:
                raise
            errors[name] = error
    if several:
        print_results(out, outputs, errors)
        raise_errors(len(folders), errors)


def print_table(out: Output, found: ConfiguredKeys, *, changed: bool) -> None:
    """Prints keys as a table or as a document."""
    keys = [key for key in found.settings if not changed or key.value != key.default or key.pending]
    if out.settings.structured:
        out.document(msgspec.structs.replace(found, settings=keys))
        return
    details: list[Detail[ConfiguredKey]] = [
        Detail("KEY", value=lambda key: key.key),
        Detail("VALUE", value=lambda key: brief(key.value), wraps=True),
        Detail("UNIT", value=lambda key: unit_suffix(key.unit).strip()),
        Detail("FROM", value=lambda key: key.source, drop=1),
        Detail("CHANGE", value=lambda key: "live" if key.live else "restart", drop=2),
        Detail("DEFAULT", value=lambda key: brief(key.default), wide=True),
        Detail("RANGE", value=lambda key: key.range, wide=True),
        Detail("TYPE", value=lambda key: key.type, wide=True),
        Detail("BY", value=lambda key: key.changed_by, wide=True),
        Detail(
            "AT", value=lambda key: utc_text(key.changed_utc_ns) if key.changed_utc_ns else None, wide=True
        ),
    ]
    out.table(details, rows_of(details, keys), empty=f"{found.platform}: every key has its default")
    _warn(out, found)


def _warn(out: Output, found: ConfiguredKeys) -> None:
    for problem in found.problems:
        out.warn(f"{found.platform}: {problem}")


async def describe(session: Session, patterns: tuple[str, ...]) -> None:
    """Prints what keys mean, their limits, origin and how to change them.

    Raises: as `configured`.
    """
    found = [await configured(session, pattern, meanings=True) for pattern in patterns]
    # overlapping patterns name a key twice
    keys = list({key.key: key for one in found for key in one.settings}.values())
    problems = list(dict.fromkeys(problem for one in found for problem in one.problems))
    all_of_them = ConfiguredKeys(keys, found[0].platform, problems)
    if session.settings.structured:
        session.out.document(all_of_them)
        return
    lines = [line for key in keys for line in (*_description(key, found[0].platform), "")]
    session.out.text(*lines[:-1])
    _warn(session.out, all_of_them)


def _description(key: ConfiguredKey, platform: str) -> list[str]:
    unit = unit_suffix(key.unit)
    lines = [
        ("value", f"{brief(key.value)}{unit}, {key.source}" + ("" if key.running else "; does not run")),
        ("default", f"{brief(key.default)}{unit}"),
        ("type", f"{key.type}, {key.range}" if key.limits else key.type),
        ("file", f"{key.file}, {key.file_key}" if key.service else ""),
        ("changed", f"{utc_text(key.changed_utc_ns)} by {key.changed_by}" if key.changed_utc_ns else ""),
        ("change", change_command(key, platform)),
    ]
    head = f"{key.key}: {key.meaning}" if key.meaning else key.key
    return [head, *(f"  {name:8}{text}" for name, text in lines if text)]


def change_command(key: ConfiguredKey, platform: str) -> str:
    """What an operator runs to change a key."""
    if key.live:
        return f"swarmctl config set {key.key} VALUE -n {platform}"
    file = f"set {key.file_key} in {key.file} on {platform}"
    if key.service == "node":
        return f"{file}, then end and start the node there: `swarmctl docs howto/restart`"
    return f"{file}, then `swarmctl app restart {key.service} -n {platform}`"
