"""Requests to the fork server of the node, and the started process of a service.

The fork server has imported the modules of the daemons and forks itself: a start takes milliseconds, not half
a second of processor time. Without a fork server, or if it does not answer, a process starts with a new
interpreter.
"""

from __future__ import annotations

import os
import select
import sys

from swarmware.errors import OutOfRange
from swarmware.footprint.annotations import Final
from swarmware.footprint.plain import signal, socket
from swarmware.runtime.pidfd import ProcessHandle
from swarmware.service.exit_status import ExitStatus

Path = str | os.PathLike[str]
FOLDER: Final = "parent"
"""Folder in the run directory, closed to other users: sockets of the parent and of its fork server."""
SOCKET: Final = "fork"
VARIABLE: Final = "SWARM_FORK_SERVER"
"""Environment variable with the socket of a fork server that several nodes share, such as in a lab."""
MESSAGE_BYTES: Final = 8192
REQUEST_BYTES: Final = 1 << 16
"""Maximum size of a request: mostly the environment of the new process."""
_OWN_NETWORK: Final = "/proc/self/ns/net"
ANSWER_S: Final = 2.0
"""A fork takes milliseconds; a server that needs longer hangs, and is killed: the parent starts another."""
ENDED_S: Final = 0.3
"""Wait for the exit status: the kernel reports the end first, the fork server the status a moment later."""
_PEER_BYTES: Final = 12
"""Three `int`: pid, uid, gid. Source: unix(7), SO_PEERCRED."""


def own_folder(run_dir: Path, name: str) -> str:
    """Folder in the run directory that is closed to other users; created if missing."""
    folder = os.path.join(run_dir, name)
    os.makedirs(os.path.dirname(os.path.abspath(run_dir)), exist_ok=True)
    for path in (run_dir, folder):
        try:
            os.mkdir(path, mode=0o700)
        except FileExistsError:
            pass
    return folder


class StartedProcess:
    """A started process; `status` receives its exit status if the fork server is its parent."""

    def __init__(self, pid: int, status: socket.socket | None = None, started: int = 0) -> None:
        """`started` as in `ProcessHandle`, for a process that another process started."""
        self.pid = pid
        self.started = started
        self.status = status

    def exit_status(self, timeout_s: float = 0.0) -> ExitStatus:
        """The exit status of the process, as far as it is known now."""
        if self.status is None:
            return _collected(self.pid)
        poller = select.poll()
        poller.register(self.status, select.POLLIN)
        if poller.poll(timeout_s * 1000):
            try:
                return ExitStatus.parse(self.status.recv(MESSAGE_BYTES).decode("ascii", "replace"))
            except OSError:  # the fork server was killed: the exit status is lost
                pass
        return ExitStatus()

    def close(self) -> None:
        """Discard the exit status."""
        if self.status is not None:
            self.status.close()
            self.status = None


def request_fork(
    names: list[str], config_dir: Path, run_dir: Path, variables: dict[str, str]
) -> StartedProcess | None:
    """Request a process of these services from the node's fork server; returns None without an answer.

    The process has this environment, and the working directory, output and network of this process.
    """
    shared = os.environ.get(VARIABLE)
    server = shared or os.path.join(run_dir, FOLDER, SOCKET)
    return request_fork_of(server, names, config_dir, variables, shared=bool(shared))


def request_fork_of(
    server: str,
    names: list[str],
    config_dir: Path,
    variables: dict[str, str],
    *,
    shared: bool,
    output: int = 1,
    errors: int = 2,
    answer_s: float | None = None,
) -> StartedProcess | None:
    """Request a process of these services from the server with this socket; returns None without an answer.

    The process has this environment, these descriptors for its output, and the working directory and network
    of this process. `shared`: a server that hangs is not killed; `answer_s`: ANSWER_S unless it is given.
    """
    asking = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_CLOEXEC)
    try:
        asking.settimeout(ANSWER_S if answer_s is None else answer_s)
        asking.connect(server)
        words = [os.fspath(config_dir), os.getcwd(), str(len(names)), *names]
        _send(asking, words, variables, output, errors)
        pid = int(asking.recv(MESSAGE_BYTES) or b"0")
    except TimeoutError:
        if not shared:  # a shared server is only slow, because other nodes are being started
            _end_server(asking)
        pid = 0
    except (OSError, ValueError):
        pid = 0  # no fork server runs, it is being started, or it has just died
    if not pid:
        asking.close()
        return None
    asking.setblocking(False)
    return StartedProcess(pid, asking)


def _send(
    asking: socket.socket, words: list[str], variables: dict[str, str], output: int, errors: int
) -> None:
    """Sends a request with these descriptors and the network of this process. Raises: OSError, OutOfRange."""
    text = os.fsencode("\0".join([*words, *(f"{key}={value}" for key, value in variables.items())]))
    if len(text) > REQUEST_BYTES:
        raise OutOfRange(f"an environment of {len(text)} bytes; expected at most {REQUEST_BYTES}")
    network = os.open(_OWN_NETWORK, os.O_RDONLY | os.O_CLOEXEC)
    try:
        files = b"".join(fd.to_bytes(4, sys.byteorder) for fd in (output, errors, network))
        asking.sendmsg([text], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, files)])
    finally:
        os.close(network)


def _end_server(asking: socket.socket) -> None:
    """Kill a fork server that hangs; it does not fork for a closed connection."""
    peer = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER_BYTES)
    pid, uid, _ = memoryview(peer).cast("i")
    if uid != os.getuid() or pid <= 0:
        return
    try:
        server = ProcessHandle(pid)
    except ProcessLookupError:
        return
    try:
        poller = select.poll()
        poller.register(asking, 0)
        if not poller.poll(0):  # still connected, so the server runs and the handle is its own
            server.signal(signal.SIGKILL)
    finally:
        server.close()


def _collected(pid: int) -> ExitStatus:
    try:
        result = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG)
    except ChildProcessError:
        return ExitStatus()  # a child of another process, which receives its exit status
    return ExitStatus() if result is None else exit_status_of(result)


def exit_status_of(result: os.waitid_result) -> ExitStatus:
    """The exit status in a result of `waitid`."""
    if result.si_code == os.CLD_EXITED:
        return ExitStatus(code=result.si_status)
    return ExitStatus(signal=result.si_status)
