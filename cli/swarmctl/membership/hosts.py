"""The file of a fleet (HOSTS.toml): hosts, how they are reached, and the configuration of their nodes."""

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec

from swarmctl.commandline.nodes import NodeSelection
from swarmware.errors import InvalidInput
from swarmware.mission.folder import is_mission
from swarmware.mission.manifest import MANIFEST
from swarmware.model import document
from swarmware.model.config import NodeConfig, convert
from swarmware.model.explanation import explain
from swarmware.model.toml_lines import KeyPath, key_text

CONFIG: Final = "config/"
"""Prefix of the names of files in the configuration folder of a node."""
NODE_FILE: Final = "config/node.toml"
DATA: Final = "data/"
"""Prefix of the names of files in the data folder of a node."""

_NAMED: Final = re.compile(r"key (\w+): ")
"""Start of the error message of a check between keys of a node."""

Address = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_\[:][A-Za-z0-9_.:%\]-]{0,252}$")]
"""A name or an IP address, never with a leading dash, which ssh would read as an option."""
PlatformName = Annotated[
    str,
    msgspec.Meta(
        pattern=r"^[a-z][a-z0-9_]{0,30}$",
        description="the name of a platform, [a-z][a-z0-9_]{0,30}, such as uav3",
    ),
]
User = Annotated[str, msgspec.Meta(pattern=r"^[a-z_][a-z0-9_-]{0,31}$")]
AbsolutePath = Annotated[str, msgspec.Meta(pattern=r"^/[^\x00\n]+$")]
Port = Annotated[int, msgspec.Meta(ge=1, le=65535)]


class HostDefaults(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Defaults of the keys of all hosts; folders are relative to the file."""

    user: User = "root"
    """User of the SSH connection."""
    port: Port = 22
    """TCP port of the SSH server."""
    identity: str = ""
    """File of the private SSH key, or "" for the key that `ssh` or its agent selects."""
    known_hosts: str = ""
    """File of the known host keys, or "" for the default of `ssh`."""
    sudo: bool = False
    """Run everything by `sudo -n`, for a user other than root."""
    prefix: AbsolutePath = "/opt/swarm"
    """Virtual environment of Swarmware on the host."""
    config_dir: AbsolutePath = "/etc/swarm"
    """Configuration folder of the node on the host."""
    supervisor: Literal["systemd", "none"] = "systemd"
    """Starter of the node: a unit of systemd, or `swarmd node` as a detached process for `none`."""
    unit: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9@._-]*$")] = "swarm.target"
    """Unit of systemd that is started and stopped."""
    pip: tuple[str, ...] = ()
    """Further arguments of `pip install`, such as --no-index and --find-links for hosts without a network."""
    services: str = ""
    """Folder with the files of services (broker.toml …), or "" to push none."""
    missions: tuple[str, ...] = ()
    """Folders of missions, for ground stations."""
    node: dict[str, Any] = {}
    """Keys of node.toml."""


class HostEntry(HostDefaults, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One host; `defaults` fills the keys that it leaves out, and also the missing keys of its `node`."""

    name: PlatformName
    """Name of the platform: [a-z][a-z0-9_]{0,30}, unique in the file."""
    address: Address
    """Host name or IP address."""


class FleetFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contents of a file of hosts."""

    defaults: HostDefaults = HostDefaults()
    """Keys of all hosts."""
    hosts: Annotated[tuple[HostEntry, ...], msgspec.Meta(min_length=1, max_length=1000)]
    """The hosts, each with one node."""


class FleetHost(msgspec.Struct, frozen=True):
    """A host with all its keys, each its own or the default."""

    name: str
    address: str
    keys: HostDefaults
    """Keys with the values for this host."""
    folder: Path
    """Folder of the file, to which its paths are relative."""

    @property
    def node(self) -> dict[str, Any]:
        """The complete content of the host's node.toml."""
        return {**self.keys.node, "platform": self.name}


def read_hosts(path: Path) -> list[FleetHost]:
    """Read a file of hosts.

    Raises: ConfigError with file, line, key and expected value; FileNotFoundError.
    """
    return parse_hosts(document.read(path), path)


def parse_hosts(text: str, path: Path) -> list[FleetHost]:
    """The hosts of this text; `path` is named in errors.

    Raises: ConfigError with file, line, key and expected value.
    """
    source = str(path)
    raw = document.toml(text, source)
    file = convert(raw, FleetFile, source, text)
    # a decoded entry does not distinguish a missing key from a repeated built-in default
    given = [frozenset(map(str, one)) for one in raw["hosts"]]
    found = [
        _whole(file.defaults, *pair, path.absolute().parent) for pair in zip(file.hosts, given, strict=True)
    ]
    for place, message in _contradictions(file, found):
        raise document.refusal(source, text, place, f"key {key_text(place)}: {message}")
    return found


def choose(hosts: list[FleetHost], selection: str, path: Path) -> list[FleetHost]:
    """The selected hosts, or all hosts without a selection.

    Raises: NotFound naming the known ones.
    """
    if not selection:
        return hosts
    by_name = {host.name: host for host in hosts}
    return [by_name[name] for name in NodeSelection(selection).choose(by_name, str(path))]


def _whole(defaults: HostDefaults, one: HostEntry, given: frozenset[str], folder: Path) -> FleetHost:
    """A host whose keys are its own if they are in `given`, the keys of its table, else the defaults."""
    own = {name: getattr(one, name) for name in HostDefaults.__struct_fields__ if name in given - {"node"}}
    node = {**defaults.node, **one.node}
    return FleetHost(one.name, one.address, msgspec.structs.replace(defaults, **own, node=node), folder)


def _contradictions(file: FleetFile, whole: list[FleetHost]) -> Iterator[tuple[KeyPath, str]]:
    """Contradictions between keys, which the types cannot express."""
    places: dict[tuple[str, int, str], str] = {}
    names: set[str] = set()
    for number, (one, host) in enumerate(zip(file.hosts, whole, strict=True)):
        here: KeyPath = ("hosts", number)
        if one.name in names:
            yield (*here, "name"), f"{one.name!r} is a host already; expected unique names"
        names.add(one.name)
        other = places.setdefault((host.address, host.keys.port, host.keys.config_dir), one.name)
        if other != one.name:
            yield (*here, "address"), f"the same host and config_dir as {other!r}; expected another"
        # `FleetHost.node` sets this key, so a given value would be ignored
        if "platform" in host.keys.node:
            table: KeyPath = (*here, "node") if "platform" in one.node else ("defaults", "node")
            yield (*table, "platform"), "is the name of the host; expected to be left out"
        try:
            msgspec.convert(host.node, NodeConfig, strict=True)
        except msgspec.ValidationError as error:
            found = explain(str(error), host.node, NodeConfig)
            inside = found.path
            # a check between keys has no path, only the name of a key in its message
            if not inside and (named := _NAMED.match(found.error)):
                inside = (named[1],)
            # the error is shown where the operator wrote the key: at the host or in the defaults
            own = not inside or inside[0] in one.node
            yield (*(here if own else ("defaults",)), "node", *inside), _NAMED.sub("", found.error)


def files(host: FleetHost) -> dict[str, bytes]:
    """The files that a push brings to this host, by name below CONFIG or DATA.

    Raises: OSError; InvalidInput for a folder without the expected content.
    """
    import tomli_w

    keys = host.keys
    found = {NODE_FILE: tomli_w.dumps(host.node).encode()}
    if keys.services:
        folder = host.folder / keys.services
        paths = [path for path in sorted(folder.iterdir()) if path.suffix == ".toml"]
        found |= {f"{CONFIG}services/{path.name}": path.read_bytes() for path in paths}
    for name in keys.missions:
        mission = (host.folder / name).resolve()
        if not is_mission(mission):
            raise InvalidInput(f"mission {mission}: no {MANIFEST} in it; expected the folder of a mission")
        found |= {
            f"{DATA}missions/{mission.name}/{path.relative_to(mission)}": path.read_bytes()
            for path in sorted(mission.rglob("*"))
            if path.is_file()
        }
    return found


def digest(content: dict[str, bytes]) -> str:
    """Digest of the names and contents of files."""
    return digest_of(sums(content))


def sums(content: dict[str, bytes]) -> dict[str, str]:
    """The SHA-256 sum of each file."""
    return {name: hashlib.sha256(data).hexdigest() for name, data in content.items()}


def digest_of(sums: dict[str, str]) -> str:
    """Digest of files by their names and SHA-256 sums."""
    return hashlib.sha256(msgspec.json.encode(sorted(sums.items()))).hexdigest()


def host_names(file: str, begun: str) -> list[str]:
    """Names of hosts in this file that begin with `begun`; none if the file cannot be read."""
    try:
        found = document.toml(document.read(Path(file)), file).get("hosts", [])
        names = [str(one["name"]) for one in found if "name" in one]
    except (OSError, ValueError, TypeError, AttributeError):
        return []
    return [name for name in names if name.startswith(begun)]
