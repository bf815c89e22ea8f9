"""Configuration files: TOML as typed Structs; each error names file, line, key and the expected value."""

import os
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

import msgspec

from swarmware.errors import ConfigError, InvalidInput
from swarmware.model import document, paths
from swarmware.model.names import check_application, check_platform, segment
from swarmware.model.platform_kind import PlatformKind

T = TypeVar("T")

DEFAULT_DIR: Final = Path("/etc/swarm")
CONFIG_VARIABLE: Final = "SWARM_CONFIG"
"""Environment variable that names the configuration folder, for daemons, commands and modules alike."""

RUN_DIR_LIMIT: Final = 88
"""Bytes of the folder of sockets: a socket's path has 107 (unix(7)), the longest name in the folder 19."""


class ClockConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The simulated error of this node's clock; zero outside the lab."""

    offset_s: Annotated[float, msgspec.Meta(ge=-3600, le=3600)] = 0.0
    """Offset to the machine's monotonic clock."""
    drift_ppm: Annotated[float, msgspec.Meta(ge=-500, le=500)] = 0.0
    """Relative rate error of the clock."""


class RealtimeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Services whose processes have real-time scheduling, where the computer permits it."""

    policy: Literal["fifo", "rr"] = "fifo"
    """SCHED_FIFO, or SCHED_RR, in which equal priorities share a core in turn."""
    services: dict[str, Annotated[int, msgspec.Meta(ge=1, le=99)]] = {}
    """Priorities by service: 99 is the highest, the threads of the kernel for devices have 50."""
    required: bool = False
    """Whether a service without real-time scheduling is an error, which refuses arming, or else a warning."""


class NodeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Configuration of a node: platform, services and folders (node.toml)."""

    platform: str = "uav1"
    """Name of the platform: [a-z][a-z0-9_]{0,30}."""
    unit: str = "main"
    """Name of this computer on the platform."""
    kind: PlatformKind = PlatformKind.UAV
    """Kind of the platform."""
    template: str = "multirotor"
    """Resource template, a file of share/swarm/templates without its ending."""
    airframe: str = ""
    """Airframe that the flight controller flies, a file of share/swarm/airframes without its ending, or ""
    if the chassis has its own attitude control."""
    services: tuple[str, ...] = (
        "broker",
        "tree",
        "register",
        "timesync",
        "health",
        "guard",
        "mission",
        "logger",
        "hal",
        "sim",
        "control",
        "navigator",
    )
    """Services of this node, in the order in which they start."""
    processes: Literal["one", "per-daemon"] = "one"
    """All services in one process, or a process for each."""
    fork_server: bool = False
    """Whether `swarmd node` keeps a process that has imported the daemons also where all services are in one
    process: it is back after a crash in a third of the time, for 20 MB. Per daemon there always is one."""
    run_dir: str = "/run/swarm"
    """Sockets, doorbells and application files; 88 bytes at most, as a socket's path has 107."""
    shm_dir: str = ""
    """Folder of shared memory, or "" for /dev/shm/swarm-<platform>."""
    data_dir: str = "/var/lib/swarm"
    """Folder of logs, settings and missions."""
    keys_dir: str = "/etc/swarm/keys"
    """Identity and roster; without them only loopback is served."""
    share_dir: str = ""
    """Folder of templates, worlds and missions, or "" for the folder of the installed package."""
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] = "INFO"
    """Lowest level of the messages in the process log."""
    clock: ClockConfig = ClockConfig()
    realtime: RealtimeConfig = RealtimeConfig()

    def __post_init__(self) -> None:
        """Check constraints between fields; msgspec converts ValueError to its ValidationError."""
        check_platform(self.platform)
        check_platform(self.unit)
        if not self.kind.known:
            raise InvalidInput(
                f"key kind: invalid enum value {self.kind.value!r}; expected one of {', '.join(PlatformKind)}"
            )
        if self.airframe and self.kind != PlatformKind.UAV:
            raise InvalidInput(
                f"key airframe: {self.airframe!r} of a {self.kind}; expected kind uav, or none"
            )
        size = len(os.fsencode(self.run_dir))
        if size > RUN_DIR_LIMIT:
            raise InvalidInput(f"key run_dir: {size} bytes; expected at most {RUN_DIR_LIMIT}")
        seen: dict[str, str] = {}
        for name in self.services:
            check_application(name)
            other = seen.setdefault(segment(name), name)
            if other != name:
                raise InvalidInput(f"services: {other!r} and {name!r} have the same resource paths")
        if strange := sorted(self.realtime.services.keys() - set(self.services)):
            raise InvalidInput(
                f"key realtime.services: {strange[0]!r} is not one of the services of this node"
            )
        if len(set(self.services)) != len(self.services):
            raise InvalidInput("services: a name is listed twice, expected once")

    @property
    def shm_path(self) -> Path:
        """Directory of this node's shared memory."""
        return Path(self.shm_dir) if self.shm_dir else paths.shared_memory(self.platform)

    @property
    def run_path(self) -> Path:
        """Directory of this node's sockets and application files."""
        return Path(self.run_dir)

    @property
    def data_path(self) -> Path:
        """Directory of this node's persistent files."""
        return Path(self.data_dir)

    @property
    def share_path(self) -> Path:
        """Directory of templates, worlds and missions."""
        return Path(self.share_dir) if self.share_dir else share_dir()


def share_dir() -> Path:
    """Directory of the templates, worlds, missions and schemas of this installation.

    Raises: ConfigError when it is found neither in a checkout nor in an installation.
    """
    here = Path(__file__).resolve()
    candidates = [
        Path(os.environ["SWARM_SHARE"]) if "SWARM_SHARE" in os.environ else None,
        here.parents[2] / "share" / "swarm",  # a checkout: lib/swarmware/model/config.py
        *(parent / "share" / "swarm" for parent in here.parents[3:6]),  # <venv>/lib/python3/site-packages
        Path("/usr/local/share/swarm"),
        Path("/usr/share/swarm"),
    ]
    for candidate in candidates:
        if candidate is not None and (candidate / "templates").is_dir():
            return candidate
    raise ConfigError("share directory: not found; expected templates/ in it; set SWARM_SHARE to its path")


def find_config_dir(config_dir: Path | str | None = None) -> Path:
    """The configuration folder of a node: the one given, else of SWARM_CONFIG, else /etc/swarm."""
    return Path(config_dir or os.environ.get(CONFIG_VARIABLE) or DEFAULT_DIR).resolve()


def load_node(config_dir: Path) -> NodeConfig:
    """Load the configuration of a node.

    Raises: ConfigError when the file is missing or invalid.
    """
    path = config_dir / "node.toml"
    if not path.exists():
        raise ConfigError(
            f"{path}: no such file; expected a NodeConfig in TOML; {CONFIG_VARIABLE} names another folder"
        )
    return _with_control(load(path, NodeConfig))


def _with_control(node: NodeConfig) -> NodeConfig:
    """A file of version 0.1, whose navigator commanded the chassis itself, gets the service between them."""
    services = node.services
    if "control" in services or not {"hal", "navigator"} <= set(services):
        return node
    at = services.index("navigator")
    return msgspec.structs.replace(node, services=(*services[:at], "control", *services[at:]))


def load_service(config_dir: Path, name: str, cls: type[T]) -> T:
    """Configuration of one service: its file under services/, or the defaults without a file.

    Raises: ConfigError when the file is invalid.
    """
    path = paths.service_config(config_dir, name)
    other = paths.service_config(config_dir, segment(name))
    # A file with the segment's name would be ignored silently, and with it the settings.
    if other != path and other.exists():
        raise ConfigError(
            f"{other}: not the name of a service; expected the settings of {name!r} in {path.name}"
        )
    return load(path, cls) if path.exists() else cls()


def load(path: Path, cls: type[T]) -> T:
    """The file as a Struct.

    Raises: ConfigError with file, key and the expected value.
    """
    try:
        text = document.read(path)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; expected a {cls.__name__} in TOML") from None
    return parse(text, cls, str(path))


def parse(text: str, cls: type[T], source: str) -> T:
    """The TOML text as a Struct; `source` is named in errors.

    Raises: ConfigError with source, line, key and the expected value.
    """
    return convert(document.toml(text, source), cls, source, text)


def convert(raw: Any, cls: type[T], source: str, text: str = "") -> T:
    """Plain TOML or JSON data as a Struct; `source` is named in errors, `text` is the TOML for their lines.

    Raises: ConfigError with source, key and the expected value.
    """
    try:
        return msgspec.convert(raw, cls, strict=True)
    except msgspec.ValidationError as error:
        from swarmware.model.explanation import explain  # valid configuration needs none

        found = explain(str(error), raw, cls)
        raise document.refusal(source, text, found.path, found.text) from error
    except InvalidInput as error:
        raise ConfigError(str(error), source=source) from error
