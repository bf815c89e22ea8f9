"""State of a lab: lab.json in its folder, written by the process that started it, read by every command."""

import os
import re
import stat
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.commandline.completion import default_labs_folder
from swarmctl.commandline.nodes import NodeSelection
from swarmctl.commandline.settings import CliSettings
from swarmctl.session.processes import NODE_MARK, ProcessIdentity, marked, marks
from swarmware.errors import ConfigError, Denied, InvalidInput, NotFound
from swarmware.model import document
from swarmware.model.platform_kind import PlatformKind
from swarmware.runtime.filewriter import replace_file

FILE: Final = "lab.json"
_NAME: Final = re.compile(r"[a-z][a-z0-9_-]{0,23}\Z")


class LabNode(msgspec.Struct, frozen=True, kw_only=True):
    """One node of a lab."""

    platform: str
    """Platform, followed by the unit for a computer other than `main`, such as `uav1.fc`."""
    kind: PlatformKind
    folder: str
    """Folder with all files of this node except its shared memory."""
    shm_dir: str
    processes: str
    """Processes of the node: one | per-daemon."""
    address: str = "127.0.0.1"
    """Address of its broker."""
    namespace: str = ""
    """Link to the node's network namespace, made by the radio, or "" in the computer's own."""
    user_namespace: str = ""
    """Link to the user namespace that owns the network namespace, or "" for the computer's own."""
    offset_s: float
    """Offset of the node's simulated clock: its reading when the machine's CLOCK_MONOTONIC was 0."""
    drift_ppm: float
    pid: int = 0
    """pid of the main process, or 0 before its start."""
    pid_start: int = 0
    """Start of the process in clock ticks since boot, which differs when the pid is used again."""

    @property
    def config_dir(self) -> Path:
        """Folder of node.toml and services/."""
        return Path(self.folder) / "etc"

    @property
    def run_dir(self) -> Path:
        """Folder of sockets and application files."""
        return Path(self.folder) / "run"

    @property
    def data_dir(self) -> Path:
        """Folder of the node's logs, settings and missions."""
        return Path(self.folder) / "data"

    @property
    def keys_dir(self) -> Path:
        """Folder of the node's keys."""
        return Path(self.folder) / "keys"

    @property
    def log_file(self) -> Path:
        """File with the output of the node's processes."""
        return Path(self.folder) / "log.txt"

    @property
    def notify_path(self) -> Path:
        """Socket on which the node reports that it is ready (sd_notify)."""
        return Path(self.folder) / "notify"

    @property
    def identity(self) -> ProcessIdentity:
        """The node's main process."""
        return ProcessIdentity(self.pid, self.pid_start)

    def alive(self) -> bool:
        """Whether any of its processes runs; a killed main process may be about to restart."""
        return self.pid > 0 and (self.identity.alive() or bool(marked(self.folder, NODE_MARK)))


class LabState(msgspec.Struct, frozen=True, kw_only=True):
    """Description of one lab as its state file keeps it."""

    schema_version: int = 1
    name: str
    experiment: str
    net: str
    seed: int
    folder: str
    created_utc_ns: int
    starter: ProcessIdentity
    """Process that started the lab."""
    multicast_group: str
    udp_port: int
    radio_file: str = ""
    """Model of the radio that connects the nodes, or "" if they are connected without one."""
    mongodb_uri: str = ""
    mongodb_database: str = ""
    """Database to which the logs are forwarded, or "" if they stay on the nodes."""
    ready_s: float = 0.0
    """Time from the first start of a process until the ground station had all trees, or 0 until then."""
    nodes: tuple[LabNode, ...]
    unit_delay_ms: tuple[float, ...] = ()
    """Shortest and longest simulated delay between the computers of a vehicle, or () without a delay."""
    world: str = ""
    """World of the vehicles, or "" for the experiment's world."""
    airframes: dict[str, str] = {}
    """Airframes by air vehicle; vehicles without an entry move without a model of their airframe."""
    services: tuple[str, ...] = ()
    """Services of every node beside the usual ones."""

    def node(self, platform: str) -> LabNode:
        """The node of that platform.

        Raises: NotFound naming the existing nodes.
        """
        for node in self.nodes:
            if node.platform == platform:
                return node
        known = ", ".join(node.platform for node in self.nodes)
        raise NotFound(f"node {platform!r} (lab {self.name}): no such node; expected one of {known}")

    def select(self, selection: str) -> list[LabNode]:
        """The selected nodes in natural order, or all in the order of their numbers if `selection` is "".

        Raises: NotFound naming the existing nodes when a name or a pattern matches none.
        """
        if not selection:
            return list(self.nodes)
        known = {node.platform: node for node in self.nodes}
        return [known[name] for name in NodeSelection(selection).choose(known, f"lab {self.name}")]

    @property
    def station(self) -> LabNode:
        """The ground station's node, which commands join."""
        return next(node for node in self.nodes if node.kind == PlatformKind.GCS)

    @property
    def running(self) -> bool:
        """Whether any of its nodes runs."""
        return any(node.alive() for node in self.nodes)

    @property
    def mark(self) -> str:
        """Value of MARK in the environment of every process of this lab."""
        return self.folder


def check_name(name: str) -> str:
    """Check the name of a lab, and return it.

    Raises: InvalidInput when it is invalid.
    """
    if not _NAME.match(name):
        raise InvalidInput(f"lab name {name!r}: expected [a-z][a-z0-9_-]{{0,23}}")
    return name


def default_folder() -> Path:
    """Folder of this user's labs without SWARMCTL_LABS."""
    return Path(default_labs_folder())


def labs_folder() -> Path:
    """Folder of this user's labs; short, because sockets live below it.

    Raises: Denied when another user may write to it.
    """
    folder = Path(os.environ.get("SWARMCTL_LABS") or default_folder())
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    # lstat: a link of another user in /tmp must not lead elsewhere
    found = folder.lstat()
    # commands join and signal what the state files name, so no other user may place one here
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise Denied(f"folder of the labs ({folder}): expected a directory that only you can write to")
    return folder


def save(state: LabState) -> None:
    """Writes lab.json; readers see either the former or the new content."""
    path = Path(state.folder) / FILE
    data = msgspec.json.format(msgspec.json.encode(state), indent=1)
    # for this user alone: the address of the database may contain a password
    replace_file(path, data, mode=0o600, durable=False)


def load(folder: Path) -> LabState:
    """The lab in this folder.

    Raises: NotFound without a lab; ConfigError when its state file is damaged.
    """
    try:
        return document.json(
            document.read(folder / FILE), LabState, f"state file of the lab ({folder / FILE})"
        )
    except FileNotFoundError:
        raise NotFound(f"lab {folder.name!r} ({folder}): no such lab") from None


def labs() -> list[LabState]:
    """All labs of this user, running or not, oldest first; damaged state files are skipped."""
    found = []
    for path in labs_folder().glob(f"*/{FILE}"):
        try:
            found.append(load(path.parent))
        except (NotFound, ConfigError):
            continue
    return sorted(found, key=lambda lab: lab.created_utc_ns)


def running_labs() -> list[LabState]:
    """All labs of this user with a running process, in any folder of labs."""
    found = []
    # by the environment of processes: a folder chosen by SWARMCTL_LABS is not known to later commands
    for mark in sorted(marks()):
        try:
            found.append(load(Path(mark)))
        except (NotFound, ConfigError):
            continue
    return found


def of_station(config_dir: Path) -> LabState | None:
    """The lab whose ground station has this configuration folder, or None."""
    return next((lab for lab in labs() if lab.station.config_dir == config_dir), None)


def find(name: str = "") -> LabState:
    """The lab of that name, or the newest that runs.

    Raises: NotFound without such a lab.
    """
    if name:
        return load(labs_folder() / check_name(name))
    running = [lab for lab in labs() if lab.running]
    if not running:
        raise NotFound("running lab: none; expected one started by `swarmctl lab up formation --detach`")
    return running[-1]


def find_left(name: str = "") -> LabState:
    """Like `find`, but includes labs of which only another process runs, such as the radio.

    Raises: NotFound without such a lab.
    """
    try:
        return find(name)
    except NotFound:
        own = [lab for lab in running_labs() if Path(lab.folder).parent == labs_folder()]
        if name or not own:
            raise
        return max(own, key=lambda lab: lab.created_utc_ns)


def chosen(settings: CliSettings) -> LabState | None:
    """The named lab or the newest that runs, or None if a node of this machine is used instead.

    Raises: NotFound when the named one does not exist.
    """
    if settings.config_dir is not None:
        return None
    try:
        return find(settings.lab)
    except NotFound:
        if settings.lab:
            raise
        return None
