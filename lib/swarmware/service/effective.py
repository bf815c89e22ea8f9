"""The effective configuration of a node: every key of its files and every live setting, by one name each."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from swarmware.errors import ConfigError, NotFound
from swarmware.model import document, paths
from swarmware.model.acl import load_acl
from swarmware.model.config import NodeConfig, convert, load_node
from swarmware.model.names import Pattern, segment
from swarmware.model.stored_setting import LiveValue
from swarmware.model.toml_lines import KeyPath, toml_lines
from swarmware.recorder.address import without_password
from swarmware.service.channels import load_channels
from swarmware.service.config_keys import KeyDescription, described_keys
from swarmware.service.installed import find
from swarmware.types.config import ConfigKey, ConfigOrigin, EffectiveConfig

NODE = "node"
"""Name of node.toml among the services."""


class _ConfigFile(NamedTuple):
    """One configuration file of the node."""

    service: str
    path: Path
    value: dict[str, Any] | None
    """Value by the file and the defaults, or None if the file is invalid."""
    lines: Mapping[KeyPath, int]
    problem: str


def effective_config(
    folder: Path,
    running: Mapping[str, Mapping[str, Any]],
    live: Mapping[str, LiveValue],
    pattern: str = "**",
    *,
    meanings: bool = False,
    node: NodeConfig | None = None,
) -> EffectiveConfig:
    """The matching keys of the node whose files are in `folder`.

    `running`: configurations of the services that run, as they have read them, by name, `node` too; `live`:
    live settings, by path; `node`: configuration of the running node, whose file may be invalid now.
    Raises: ConfigError for an invalid node.toml without `node`, InvalidInput for an invalid pattern.
    """
    wanted = key_pattern(pattern)
    node = node if node is not None else load_node(folder)
    keys: list[ConfigKey] = []
    problems: list[str] = []
    # what no file declares remains in it, and is listed last
    left = dict(live)
    classes: dict[str, tuple[str, type[msgspec.Struct], dict[str, str]]] = {}
    for name in (NODE, *node.services):
        try:
            service, cls, live_settings = _class_of(name)
        except (NotFound, ConfigError) as error:
            problems.append(str(error))
            continue
        # the parts of a service have one file
        classes.setdefault(service, (name, cls, {}))[2].update(live_settings)
    for service, (running_name, cls, live_settings) in classes.items():
        chosen: list[tuple[str, KeyDescription, LiveValue | None]] = []
        for key in described_keys(cls):
            plain_name = f"{segment(service)}/{key.name}"
            name = live_settings.get(key.name, plain_name)
            setting = left.pop(paths.setting(name), None)
            if wanted(name) or wanted(plain_name):
                chosen.append((name, key, setting))
        if not chosen:
            continue
        # only files with a matching key are read
        file = _read(folder, service, cls)
        if file.problem:
            problems.append(file.problem)
        for name, key, setting in chosen:
            keys.append(_key(name, key, file, running.get(running_name), setting, meanings=meanings))
    # these files have no keys of their own; only their errors are reported
    for load_file in (load_acl, load_channels):
        try:
            load_file(folder)
        except ConfigError as error:
            problems.append(str(error))
    for path, setting in left.items():
        name = path.removeprefix(paths.setting(""))
        if wanted(name):
            keys.append(_of_setting(name, setting, meanings=meanings))
    return EffectiveConfig(node.platform, tuple(keys), tuple(problems))


def key_pattern(text: str) -> Callable[[str], bool]:
    """Whether the name of a key matches a pattern; a dot does not end a segment.

    `navigator/*` has the keys of tables too.

    Raises: InvalidInput when it is not a pattern.
    """
    pattern = Pattern(_one_segment(text))
    return lambda name: pattern.matches(_one_segment(name))


def _one_segment(name: str) -> str:
    return name.replace(".", "_").lower()


def _class_of(service: str) -> tuple[str, type[msgspec.Struct], Mapping[str, str]]:
    """Name of the file, class of the configuration, and its live settings. Raises: NotFound, ConfigError."""
    if service == NODE:
        return NODE, NodeConfig, {}
    found = find(service)
    return found.settings_of or service, found.Config, found.live_settings


def _read(folder: Path, service: str, cls: type[msgspec.Struct]) -> _ConfigFile:
    path = folder / "node.toml" if service == NODE else paths.service_config(folder, service)
    value: dict[str, Any] | None = None
    lines: Mapping[KeyPath, int] = {}
    problem = ""
    try:
        text = document.read(path)
        value = _plain(msgspec.to_builtins(convert(document.toml(text, str(path)), cls, str(path))))
        lines = toml_lines(text)
    except FileNotFoundError:
        # without a file the defaults are in force
        value = _plain(msgspec.to_builtins(cls()))
    except ConfigError as error:
        problem = str(error)
    return _ConfigFile(service, path, value, lines, problem)


def _key(
    name: str,
    key: KeyDescription,
    file: _ConfigFile,
    running: Mapping[str, Any] | None,
    setting: LiveValue | None,
    *,
    meanings: bool,
) -> ConfigKey:
    by_file = None if file.value is None else _at(file.value, key.name)
    # the running service decides: its file may have changed since it was read
    own = by_file if running is None else _plain(_at(running, key.name))
    line = file.lines.get(tuple(key.name.split(".")), 0)
    pending = running is not None and file.value is not None and own != by_file
    # The service may run with a former content of the file, whose lines are not known any more.
    written = own != _plain(key.default) if pending or file.value is None else line > 0
    origin = ConfigOrigin.FILE if written else ConfigOrigin.DEFAULT
    made = ConfigKey(
        name=name,
        value=_packed(own),
        origin=origin,
        type=key.type,
        unit=key.unit,
        default=_packed(key.default),
        limits=key.limits.replace("`", ""),
        live=setting is not None,
        service=file.service,
        file=str(file.path),
        key=key.name,
        line=line,
        file_value=b"" if file.value is None else _packed(by_file),
        pending=pending,
        running=running is not None,
        meaning=key.meaning if meanings else "",
    )
    return made if setting is None else _live(made, setting)


def _of_setting(name: str, setting: LiveValue, *, meanings: bool) -> ConfigKey:
    """A live setting without a file: a module declares it."""
    resource = setting.resource
    made = ConfigKey(
        name=name,
        value=_packed(resource.default),
        origin=ConfigOrigin.DEFAULT,
        type={"Float": "float", "Int": "integer", "Bool": "boolean", "Text": "string"}[resource.type],
        unit=resource.unit,
        default=_packed(resource.default),
        limits="",
        live=True,
        meaning=resource.description if meanings else "",
    )
    return _live(made, setting)


def _live(made: ConfigKey, setting: LiveValue) -> ConfigKey:
    resource, stored = setting.resource, setting.stored
    last = stored.history[-1] if stored is not None and stored.history else None
    limits = ", ".join(resource.choices)
    if resource.range is not None:
        limits = "[{:g}, {:g}]".format(*resource.range).replace("-", "−")
    return msgspec.structs.replace(
        made,
        value=made.value if setting.value is None else _packed(setting.value),
        origin=ConfigOrigin.LIVE if setting.overrides else made.origin,
        unit=resource.unit or made.unit,
        limits=limits or made.limits,
        version=0 if stored is None else stored.version,
        by="" if last is None else last.by,
        utc_ns=0 if last is None else last.utc_ns,
    )


def _at(value: Mapping[str, Any], key: str) -> Any:
    """The plain value of a dotted key, or None if it is omitted."""
    found: Any = value
    for part in key.split("."):
        found = found.get(part) if isinstance(found, Mapping) else None
    return found


def _plain(value: Any) -> Any:
    """The value as TOML represents it: without None, lists for tuples."""
    match value:
        case dict():
            return {key: _plain(item) for key, item in value.items() if item is not None}
        case list() | tuple():
            return [_plain(item) for item in value if item is not None]
    return value


def _packed(value: Any) -> bytes:
    return msgspec.msgpack.encode(_masked(value))


def _masked(value: Any) -> Any:
    """The value without the passwords of addresses: it leaves the node."""
    match value:
        case str():
            return without_password(value)
        case list() | tuple():
            return [_masked(item) for item in value]
        case dict():
            return {key: _masked(item) for key, item in value.items()}
    return value
