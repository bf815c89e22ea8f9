"""The part of `fleet` that runs on a host, in the Python of its installation; it answers in JSON.

It holds a lock while it acts, so that two calls never change one node at the same time.
"""

import asyncio
import fcntl
import hashlib
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path, PurePosixPath
from signal import SIGTERM
from typing import Final, Literal

import msgspec

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.fleet.plan import HostStatus
from swarmctl.installation.host import Host
from swarmctl.installation.plan import TARGET, start_unit
from swarmctl.membership.hosts import CONFIG, DATA, NODE_FILE, digest, digest_of, sums
from swarmctl.resources.restart import is_armed
from swarmctl.session.processes import ProcessIdentity, identity, wait_gone
from swarmctl.session.session import connect
from swarmware import __version__
from swarmware.errors import Conflict, Denied, InvalidInput, NoAnswer, NotFound, SwarmError
from swarmware.model.config import NodeConfig, load_node, parse
from swarmware.model.document import text
from swarmware.model.platform_kind import VEHICLES
from swarmware.runtime.filewriter import replace_file
from swarmware.runtime.pidfd import ProcessHandle
from swarmware.service.installed import find
from swarmware.service.notify import NotificationSocket
from swarmware.transport.appfile.table import populated
from swarmware.types.mission import INACTIVE, MissionState, MissionStatus
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo

RECORD: Final = ".fleet.json"
"""File in the configuration folder that records what `fleet` has pushed and started."""
STAGED: Final = ".fleet-staged"
"""File in the configuration folder with received and checked files that are not all in place yet."""
LOCK: Final = ".fleet.lock"
NODE: Final = "node.toml"
INSTALLED: Final = "wheel/installed"
"""File in the environment with the SHA-256 sum of the installed wheel."""
MODE: Final = 0o644
ANSWER_S: Final = 2.0
"""Maximum wait for the answer of the node to this agent."""
RETRY_S: Final = 0.25
TAIL_LINES: Final = 5


class HostOrder(msgspec.Struct, frozen=True):
    """Order of the operator's command to the agent."""

    verb: Literal["status", "push", "start", "stop"]
    config_dir: str
    prefix: str
    supervisor: str
    unit: str
    force: bool = False
    """Whether to stop even an armed vehicle or a node that does not answer."""
    resume: bool = False
    """Whether the node is stopped for an upgrade."""
    digest: str = ""
    """Digest of the files of a push."""
    wait_s: float = 60.0


class AgentError(msgspec.Struct, frozen=True):
    """An error on the host."""

    error: str
    exit_code: int


class FleetRecord(msgspec.Struct, frozen=True):
    """Record of the actions of `fleet` on this host."""

    files: dict[str, str] = {}
    """SHA-256 sum of each pushed file."""
    pid: int = 0
    start_ticks: int = 0
    started_config: str = ""
    """Digest of the pushed files when the node was started."""
    resume: bool = False
    """Whether an upgrade stopped the node and has not started it again."""

    @property
    def process(self) -> ProcessIdentity:
        """The started process `swarmd node`, which never existed for a unit of systemd."""
        return ProcessIdentity(self.pid, self.start_ticks)


def main(words: list[str]) -> int:
    """Carry out one order; prints the status of the host or an error, and returns 0 for both."""
    try:
        order = msgspec.json.decode(words[0], type=HostOrder)
        received = sys.stdin.buffer.read() if order.verb == "push" else b""
        result: msgspec.Struct = HostAgent(order).carry_out(received)
    except (SwarmError, OSError, msgspec.DecodeError) as error:
        result = AgentError(str(error), error.exit_code if isinstance(error, SwarmError) else 1)
    sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
    return 0


class HostAgent:
    """The node of this host: its files, its processes and what `fleet` recorded of them."""

    def __init__(self, order: HostOrder) -> None:
        self._order = order
        self._folder = Path(order.config_dir)

    def carry_out(self, received: bytes) -> HostStatus:
        """Carry out the order; `received`: the files of a push.

        Raises: SwarmError and OSError; the order can be repeated then.
        """
        # without the lock, so that a status is answered while another call acts
        if self._order.verb == "status":
            return self._status()
        self._folder.mkdir(parents=True, exist_ok=True)
        with self._locked():
            if self._staged.exists():  # a push that was interrupted when it was complete here
                self._put_in_place(self._staged.read_bytes())
            match self._order.verb:
                case "push":
                    self._push(received)
                case "start":
                    self._start()
                case "stop":
                    self._stop()
            return self._status()

    @contextmanager
    def _locked(self) -> Iterator[None]:
        with (self._folder / LOCK).open("w") as file:
            # released by the kernel when the process ends, so a broken connection leaves no lock behind
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    # -- files

    @property
    def _staged(self) -> Path:
        return self._folder / STAGED

    def _record(self) -> FleetRecord:
        try:
            return msgspec.json.decode((self._folder / RECORD).read_bytes(), type=FleetRecord)
        except FileNotFoundError:
            return FleetRecord()

    def _save(self, record: FleetRecord) -> None:
        replace_file(self._folder / RECORD, msgspec.json.encode(record), mode=MODE)

    def _push(self, received: bytes) -> None:
        """Checks and stores pushed files. Raises: InvalidInput, ConfigError, both before any change."""
        content = _content(received)
        if digest(content) != self._order.digest:
            raise InvalidInput("the files arrived incomplete; expected all files of the operator's folder")
        for name, data in content.items():
            check_file(name, data)
        # stored whole before the first file is replaced, so that the next order can finish the push
        replace_file(self._staged, received, mode=0o600)
        self._put_in_place(received)

    def _put_in_place(self, staged: bytes) -> None:
        """Replaces each file; the next order repeats an interrupted replacement with the same result."""
        content = _content(staged)
        node = parse(text(content[NODE_FILE], NODE_FILE), NodeConfig, NODE_FILE)
        record = self._record()
        for name, data in content.items():
            path = self._path(name, node)
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, data, mode=MODE)
        # files of a former push that are no longer in the operator's folder
        for name in record.files.keys() - content.keys():
            self._path(name, node).unlink(missing_ok=True)
        self._save(msgspec.structs.replace(record, files=sums(content)))
        # last: as long as it exists, the replacement counts as incomplete
        self._staged.unlink()

    def _path(self, name: str, node: NodeConfig) -> Path:
        return (
            self._folder / name.removeprefix(CONFIG)
            if name.startswith(CONFIG)
            else (node.data_path / name.removeprefix(DATA))
        )

    def _config(self, record: FleetRecord, node: NodeConfig) -> str:
        """Digest of the present state of the pushed files, or "" without any."""
        found: dict[str, str] = {}
        for name in record.files:
            with suppress(FileNotFoundError):
                found[name] = hashlib.sha256(self._path(name, node).read_bytes()).hexdigest()
        return digest_of(found) if record.files else ""

    # -- processes

    def _status(self) -> HostStatus:
        record = self._record()
        prefix = Path(self._order.prefix)
        wheel = (prefix / INSTALLED).read_text().strip() if (prefix / INSTALLED).exists() else ""
        if not (self._folder / NODE).exists():
            return HostStatus(installed=True, version=__version__, wheel=wheel, resume=record.resume)
        node = load_node(self._folder)
        # the run directory shows nodes that systemd or an operator has started
        running = record.process.alive() or populated(node.run_path)
        info, armed = asyncio.run(self._answer(node)) if running else (None, None)
        return HostStatus(
            installed=True,
            # a running node may still have the version from before an installation
            version=info.version if info is not None else __version__,
            wheel=wheel,
            configured=True,
            # with half of the files replaced no digest would be true
            config="" if self._staged.exists() else self._config(record, node),
            running=running,
            answers=info is not None,
            uptime_s=info.uptime_s if info is not None else None,
            started_config=record.started_config if running else "",
            armed=armed,
            resume=record.resume,
        )

    async def _answer(self, node: NodeConfig) -> tuple[NodeInfo | None, bool | None]:
        """Identity of the running node and whether it is armed, each None if the node does not answer."""
        try:
            async with connect(CliSettings(config=str(self._folder), timeout_s=ANSWER_S)) as session:
                info = await session.ask("sys/node/info", Empty(), NodeInfo)
                return info, node.kind in VEHICLES and await is_armed(session)
        except NoAnswer:
            return None, None

    def _start(self) -> None:
        """Starts the node. Raises: SwarmError with its last log lines if it ends, NoAnswer if not ready."""
        node, record = load_node(self._folder), self._record()
        started = self._config(record, node)
        deadline_s = time.monotonic() + self._order.wait_s
        if self._order.supervisor == "systemd":
            start_unit(self._order.unit, self._folder)
            # only after the start: a unit that is refused must not count as started
            self._save(FleetRecord(record.files, started_config=started))
        # a repeated call waits for the node that an interrupted one has started
        elif not record.process.alive():
            if populated(node.run_path):
                raise Conflict("the node runs, and `fleet` did not start it; expected it to be ended there")
            self._start_detached(node, FleetRecord(record.files, started_config=started), deadline_s)
        # a unit of systemd, or a ready main process, may still start services
        while not asyncio.run(self._answer(node))[0]:
            if time.monotonic() > deadline_s:
                raise NoAnswer(f"the node runs, but does not answer within {self._order.wait_s:g} s")
            time.sleep(RETRY_S)
        self._save(msgspec.structs.replace(self._record(), resume=False))

    def _start_detached(self, node: NodeConfig, record: FleetRecord, deadline_s: float) -> None:
        node.data_path.mkdir(parents=True, exist_ok=True)
        node.run_path.mkdir(parents=True, exist_ok=True)
        path = node.data_path / "swarmd.log"
        words = [str(Path(self._order.prefix) / "bin" / "swarmd"), "node", "--config", str(self._folder)]
        with closing(NotificationSocket()) as notify, path.open("ab") as log:
            # the agent's socket ends with the connection, and the node outlives it
            environment = {name: value for name, value in os.environ.items() if not name.startswith("SSH_")}
            child = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**environment, "NOTIFY_SOCKET": notify.address},
                cwd=node.data_path,
                start_new_session=True,  # it outlives the connection
            )
            who = identity(child.pid)
            # before the wait: a call that is interrupted now must find the process again
            self._save(msgspec.structs.replace(record, pid=who.pid, start_ticks=who.start_ticks))
            with closing(ProcessHandle(child.pid)) as process:
                ready = _ready(notify, process, deadline_s)
            # an ended process is reaped here, which gives its exit code
            code = child.poll()
            child.returncode = code or 0  # it continues without this process
        if code is not None:
            raise SwarmError(f"the node ended with exit code {code} ({path}): {_tail(path)}")
        if not ready:
            raise NoAnswer(f"the node is not ready within {self._order.wait_s:g} s ({path}): {_tail(path)}")

    def _stop(self) -> None:
        """Stops the node. Raises: Denied if it is armed or does not answer, NoAnswer if it does not end."""
        order, node, record = self._order, load_node(self._folder), self._record()
        ours = record.process.alive()
        if ours or populated(node.run_path):
            self._check_idle(node)
            if order.resume:
                # before the stop, so that a repeated upgrade starts the node even if this call ends in
                # between
                self._save(msgspec.structs.replace(record, resume=True))
            if order.supervisor == "systemd":
                Host().run(["systemctl", "stop", order.unit, *(["swarmd@*"] if order.unit == TARGET else [])])
            elif not ours:
                raise Conflict("the node runs, and `fleet` did not start it; expected it to be ended there")
            else:
                record.process.send(SIGTERM)
                if wait_gone([record.process], order.wait_s):
                    raise NoAnswer(f"the node, process {record.pid}, has not ended within {order.wait_s:g} s")
        self._save(FleetRecord(record.files, resume=order.resume))

    def _check_idle(self, node: NodeConfig) -> None:
        if self._order.force:
            return
        mission = asyncio.run(self._mission())
        if mission is not None and mission.state not in INACTIVE:
            raise Conflict(
                f"{node.platform}: mission {mission.mission} {mission.state}; expected its end (`swarmctl"
                f" node drain {node.platform}`), or --force"
            )
        if node.kind not in VEHICLES:
            return
        info, armed = asyncio.run(self._answer(node))
        if armed:
            raise Denied(f"{node.platform} is armed; expected a disarmed vehicle, or --force")
        if info is None:
            # no answer is the worst case: a vehicle whose broker hangs may be in flight
            raise Denied(f"{node.platform} runs and does not answer, so it may be armed; expected --force")

    async def _mission(self) -> MissionState | None:
        """State of the mission, or None without a mission service or its answer."""
        try:
            async with connect(CliSettings(config=str(self._folder), timeout_s=ANSWER_S)) as session:
                return (await session.ask("sys/mission/status", Empty(), MissionStatus)).state
        except (NoAnswer, NotFound):
            return None


def check_file(name: str, data: bytes) -> None:
    """Check a pushed file as the daemons of this host will read it.

    Raises: InvalidInput, and ConfigError with its line.
    """
    parts = PurePosixPath(name).parts
    # the agent may run as root, so no name may lead out of the two folders
    if f"{parts[0]}/" not in {CONFIG, DATA} or ".." in parts or len(parts) < 2:
        raise InvalidInput(f"file {name!r}: expected a name below {CONFIG} or {DATA}")
    if name == NODE_FILE:
        parse(text(data, name), NodeConfig, name)
    elif name.startswith(f"{CONFIG}services/"):
        parse(text(data, name), find(PurePosixPath(name).stem).Config, name)


def _content(packed: bytes) -> dict[str, bytes]:
    try:
        return msgspec.msgpack.decode(packed, type=dict[str, bytes])
    except msgspec.DecodeError as error:
        raise InvalidInput(f"the files arrived incomplete: {error}") from error


def _ready(notify: NotificationSocket, process: ProcessHandle, deadline_s: float) -> bool:
    """Whether the node reported that it is ready, before it ended and before the deadline."""
    poller = select.poll()
    for watched in (notify, process):
        poller.register(watched, select.POLLIN)
    while (left_s := deadline_s - time.monotonic()) > 0:
        found = {fd for fd, _ in poller.poll(left_s * 1000)}
        # all waiting messages: READY may follow others in the same wake-up
        while (word := notify.receive()) is not None:
            if word[1].get("READY") == "1":
                return True
        # after the messages, since a process that has ended may have sent READY before
        if process.fileno() in found:
            return False
    return False


def _tail(path: Path) -> str:
    lines = path.read_text("utf-8", "replace").splitlines()
    return " | ".join(lines[-TAIL_LINES:])
