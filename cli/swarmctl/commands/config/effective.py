"""The effective configuration of a node's files: each key with its value and origin."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from swarmctl.commandline.nodes import is_selection
from swarmctl.commandline.settings import CliSettings
from swarmctl.session.session import local_config_dirs
from swarmctl.terminal.node_output import NodeOutput, print_results, raise_errors
from swarmctl.terminal.output import Column, Output
from swarmware.errors import NotFound, SwarmError
from swarmware.model import document, paths
from swarmware.model.config import NodeConfig, load_node, load_service
from swarmware.recorder.address import without_password
from swarmware.service.installed import find, installed


class EffectiveSetting(msgspec.Struct, frozen=True):
    """One key with its value and where the value comes from."""

    service: str
    """Name of the service; `node` for node.toml."""
    key: str
    value: str
    origin: str
    """Origin of the value: `default`, or the file."""
    live: str = ""
    """Key of the live setting that overrides the value, for `config get`; empty: none."""


class EffectiveSettings(msgspec.Struct, frozen=True):
    """Settings of a node's files."""

    settings: list[EffectiveSetting]


def effective(folder: Path, service: str) -> list[EffectiveSetting]:
    """Every key of the node, or of one service.

    Raises: ConfigError for an invalid file, NotFound for a service that is not installed.
    """
    if service and service != "node" and service not in installed():
        raise NotFound(
            f"service {service!r}: not installed; expected node or one of {', '.join(installed())}"
        )
    out: list[EffectiveSetting] = []
    if service in {"", "node"}:
        out += _keys("node", folder / "node.toml", load_node(folder), NodeConfig())
    for name in load_node(folder).services if not service else [service] if service != "node" else []:
        cls = find(name).Config
        found = _keys(name, paths.service_config(folder, name), load_service(folder, name, cls), cls())
        live = find(name).live_settings
        out += [msgspec.structs.replace(one, live=live.get(one.key, "")) for one in found]
    return out


def print_effective(settings: CliSettings, service: str, out: Output, *, changed: bool) -> None:
    """Prints the keys of nodes whose files are on this machine; `changed`: only those without their default.

    Raises: as `effective` and `local_config_dirs`, Partial when it failed at some nodes.
    """
    folders = local_config_dirs(settings)
    several = is_selection(settings.node)
    outputs = {name: NodeOutput(name, out) for name in folders}
    errors: dict[str, SwarmError] = {}
    for name, folder in folders.items():
        try:
            _print_rows(effective(folder, service), outputs[name] if several else out, changed=changed)
        except SwarmError as error:
            if not several:
                raise
            errors[name] = error
    if several:
        print_results(out, outputs, errors)
        raise_errors(len(folders), errors)


def _print_rows(rows: list[EffectiveSetting], out: Output, *, changed: bool) -> None:
    if changed:
        rows = [row for row in rows if row.origin != "default"]
    if out.settings.structured:
        out.document(EffectiveSettings(rows))
        return
    out.table(
        [Column("SERVICE"), Column("KEY"), Column("FROM"), Column("VALUE")],
        [(row.service, row.key, row.origin, _shown(row)) for row in rows],
    )


def _shown(row: EffectiveSetting) -> str:
    """The value of the file; where a live setting is in force instead, the command that prints that."""
    return f"{row.value}, overridden: swarmctl config get {row.live}" if row.live else row.value


def _keys(service: str, path: Path, config: Any, defaults: Any) -> Iterator[EffectiveSetting]:
    written = set(_flat("", document.toml(document.read(path), str(path)))) if path.exists() else set()
    standard = dict(_flat("", msgspec.to_builtins(defaults)))
    for key, value in _flat("", msgspec.to_builtins(config)).items():
        origin = str(path) if key in written and value != standard.get(key) else "default"
        yield EffectiveSetting(service, key, without_password(msgspec.json.encode(value).decode()), origin)


def _flat(prefix: str, value: Any) -> dict[str, Any]:
    if isinstance(value, dict) and value:
        out: dict[str, Any] = {}
        for key, item in value.items():
            out |= _flat(f"{prefix}.{key}" if prefix else str(key), item)
        return out
    return {prefix: value}
