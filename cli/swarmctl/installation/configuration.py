"""The first configuration of a node: the shipped files with the keys that differ from host to host."""

import json
import re
from pathlib import Path
from typing import Any, Final

import msgspec

from swarmware.errors import ConfigError, Conflict, InvalidInput
from swarmware.model import document
from swarmware.model.config import NodeConfig, load_node, parse
from swarmware.model.names import MAIN, check_platform

NODE_FILE: Final = "node.toml"
GUARD_FILE: Final = "services/guard.toml"
HAL_FILE: Final = "services/hal.toml"
TEMPLATES: Final = {"uav": "multirotor", "ugv": "ugv", "usv": "usv", "gcs": "gcs"}
"""Template of a kind when none is given."""
STATION: Final = "gcs"
SELF: Final = "self"
"""Supervisor of guard.toml: the guard starts processes; the node is one unit."""
SYSTEMD: Final = "systemd"
"""Supervisor of guard.toml: each service is a unit, restarted by systemd."""
SIMULATION: Final = "sim"
"""Name of the service and of the driver of the simulation."""
UNIT: Final = ("broker", "tree", "register", "timesync", "health", "guard", "logger")
"""Services of a further computer of a platform, whose other services are on the computer `main`."""
VEHICLE_ONLY: Final = (SIMULATION, "control", "navigator")
"""Services without which a ground station runs."""


class NodeChoice(msgspec.Struct, frozen=True):
    """What an operator chose for a host; empty or False: as its files are, else the default."""

    platform: str = ""
    kind: str = ""
    template: str = ""
    real: bool = False
    """A vehicle without the simulated one."""
    single_unit: bool = False
    """The whole node in one unit of systemd, instead of a unit for each service."""
    unit: str = ""
    """Name of this computer on its platform, or "" for main."""


class HostNode(msgspec.Struct, frozen=True):
    """The node of a host, as its files will be."""

    platform: str
    services: tuple[str, ...]
    data_dir: str
    single_unit: bool
    files: dict[str, bytes]
    """Files to write below the configuration folder."""


def host_node(shipped: Path, config_dir: Path, choice: NodeChoice) -> HostNode:
    """The node of a host: its files, those that are missing taken from the shipped ones.

    Raises: InvalidInput when the name or kind of a new node is missing; Conflict when a choice contradicts a
    file; ConfigError.
    """
    files = {
        str(path.relative_to(shipped)): path.read_bytes()
        for path in sorted(shipped.rglob("*.toml"))
        # an existing file may have an operator's changes, and is never replaced
        if not (config_dir / path.relative_to(shipped)).exists()
    }
    if NODE_FILE in files:
        keys = _node_keys(files[NODE_FILE], choice)
        files[NODE_FILE] = with_keys(files[NODE_FILE], keys, NODE_FILE)
        node = parse(document.text(files[NODE_FILE], NODE_FILE), NodeConfig, NODE_FILE)
    else:
        node = load_node(config_dir)
        _check(choice, node, config_dir / NODE_FILE)
    single = _single_unit(files, config_dir, choice, node)
    # the driver of the simulation would wait for a service that does not run
    if HAL_FILE in files and SIMULATION not in node.services:
        drivers = document.toml(document.text(files[HAL_FILE], HAL_FILE), HAL_FILE)["drivers"]
        kept = [name for name in drivers if name != SIMULATION]
        files[HAL_FILE] = with_keys(files[HAL_FILE], {"drivers": kept}, HAL_FILE)
    return HostNode(node.platform, tuple(node.services), node.data_dir, single, files)


def with_keys(text: bytes, keys: dict[str, Any], source: str) -> bytes:
    """A shipped file with other values of keys of its top level; comments stay.

    Raises: ConfigError for a key that the file does not have on one line.
    """
    found = document.text(text, source)
    for key, value in keys.items():
        line = f"{key} = {json.dumps(value)}"
        found = re.sub(rf"(?m)^{key} = .*$", lambda _match, line=line: line, found, count=1)  # type: ignore[misc]
    read = document.toml(found, source)
    # the edit was textual, so only parsing shows whether it did what it should
    if missing := [key for key, value in keys.items() if read.get(key) != value]:
        raise ConfigError(
            f"{source}: no line `{missing[0]} = …`; expected the shipped file, which has every key"
        )
    return found.encode()


def _node_keys(shipped: bytes, choice: NodeChoice) -> dict[str, Any]:
    """Keys of a new node.toml. Raises: InvalidInput."""
    if not choice.platform:
        raise InvalidInput("no node.toml on this host; expected --name with the name of the platform")
    check_platform(choice.platform)
    # `uav3` is a uav unless --kind says otherwise
    kind = choice.kind or choice.platform.rstrip("0123456789_")
    if kind not in TEMPLATES:
        raise InvalidInput(
            f"--kind: not given, and the name {choice.platform!r} does not begin with one; expected one of"
            f" {', '.join(TEMPLATES)}"
        )
    services = parse(document.text(shipped, NODE_FILE), NodeConfig, NODE_FILE).services
    left_out = VEHICLE_ONLY if kind == STATION else (SIMULATION,) if choice.real else ()
    unit = check_platform(choice.unit or MAIN)
    kept = UNIT if unit != MAIN else [name for name in services if name not in left_out]
    return {
        "platform": choice.platform,
        "unit": unit,
        "kind": kind,
        "template": choice.template or TEMPLATES[kind],
        "services": list(kept),
        "processes": "one" if choice.single_unit else "per-daemon",
    }


def _single_unit(files: dict[str, bytes], config_dir: Path, choice: NodeChoice, node: NodeConfig) -> bool:
    """Whether the node runs in one unit: as guard.toml has it; a new guard.toml is written accordingly."""
    if GUARD_FILE in files:
        single = choice.single_unit
        keys = {"supervisor": SELF if single else SYSTEMD}
        files[GUARD_FILE] = with_keys(files[GUARD_FILE], keys, GUARD_FILE)
        return single
    path = config_dir / GUARD_FILE
    supervisor = document.toml(document.read(path), str(path)).get("supervisor", SELF)
    if choice.single_unit and supervisor != SELF:
        raise Conflict(
            f'{path}: supervisor = "{supervisor}"; expected "{SELF}" for one unit: edit the file, or leave'
            " out --single-unit"
        )
    return bool(supervisor == SELF)


def _check(choice: NodeChoice, node: NodeConfig, path: Path) -> None:
    """Check a choice against the file. Raises: Conflict when the file has another one."""
    found = {
        "platform": node.platform,
        "unit": node.unit,
        "kind": node.kind.value,
        "template": node.template,
    }
    wanted = {
        "platform": choice.platform,
        "unit": choice.unit,
        "kind": choice.kind,
        "template": choice.template,
    }
    for key, value in wanted.items():
        if value and value != found[key]:
            raise Conflict(
                f"{path}: {key} is {found[key]!r}, and {value!r} was given; expected the same: edit the file,"
                " or leave out the option"
            )
    if choice.real and SIMULATION in node.services:
        raise Conflict(f"{path}: services has {SIMULATION!r}; expected none for --real: edit the file")
