"""Starts processes of services; the start record of each exists until it has joined the node.

A process is forked by the fork server of the node, or started with a new interpreter. It has a session of its
own, so that a signal to the terminal or the end of the supervisor does not reach it.
"""

from __future__ import annotations

import os
import sys

from swarmware.errors import WireError
from swarmware.footprint.annotations import Final, PathLike
from swarmware.footprint.plain import signal
from swarmware.runtime.pidfd import lives, start_ticks
from swarmware.service.fork_client import FOLDER as PARENT_FOLDER
from swarmware.service.fork_client import StartedProcess, own_folder, request_fork
from swarmware.service.notify import remove_file
from swarmware.transport.shm.lock import held_by_other, lock_within
from swarmware.transport.shm.shared_file import open_shared

STARTING_DIR: Final = "starting"
"""Folder of the start records, in the run directory."""
PARENT_SOCKET: Final = "notify"
"""Socket of the parent of the node's processes, in its folder; the same one after a restart of it."""
BEAT_S: Final = 4.0
"""A process that notifies the parent resets its watchdog twice in this time."""
GUARD: Final = "guard"
WHOLE_NODE: Final = ".node"
"""Name of the start record of one process for all services; no service has such a name."""
LOCK_WAIT_S: Final = 2.0
"""A start takes some milliseconds; others wait for it before they start the same service."""
_OURS: Final = frozenset({"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID", "MAINPID"})
"""Variables between this process and its own service manager."""


def launch(
    names: list[str], config_dir: PathLike[str] | str, run_dir: PathLike[str] | str, *, notifies: bool
) -> StartedProcess:
    """Start a process of these services in a session of its own; it inherits the output of the node.

    `notifies`: it notifies the parent of the node's processes, if there is one, that it is ready and alive.
    """
    variables = environment(run_dir, notifies=notifies)
    if (forked := request_fork(names, config_dir, run_dir, variables)) is not None:
        return forked
    return StartedProcess(start(["run", *names, "--config", os.fspath(config_dir)], variables))


def start(words: list[str], variables: dict[str, str], stdin: int | None = None) -> int:
    """Start `swarmd WORDS` with an empty interpreter; its pid."""
    null = (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0)
    # this process may ignore or block SIGINT and SIGTERM; the new one must not inherit that
    return os.posix_spawn(
        sys.executable,
        [sys.executable, "-m", "swarmd", *words],
        variables,
        file_actions=[null if stdin is None else (os.POSIX_SPAWN_DUP2, stdin, 0)],
        setsid=True,
        setsigmask=[],
        setsigdef=[signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGCHLD, signal.SIGPIPE],
    )


def environment(run_dir: PathLike[str] | str, *, notifies: bool) -> dict[str, str]:
    """Environment of a new process: this process's without the variables of its service manager."""
    variables = {key: value for key, value in os.environ.items() if key not in _OURS}
    parent = os.path.join(run_dir, PARENT_FOLDER, PARENT_SOCKET)
    if notifies and os.path.exists(parent):
        variables["NOTIFY_SOCKET"] = parent
        variables["WATCHDOG_USEC"] = str(round(BEAT_S * 1e6))
    return variables


def spawn(name: str, config_dir: PathLike[str] | str, run_dir: PathLike[str] | str) -> StartedProcess:
    """Start the process of one service, and write its start record."""
    started = launch([name], config_dir, run_dir, notifies=name == GUARD)
    write_start_record(name, started.pid, run_dir)
    return started


def write_start_record(name: str, pid: int, run_dir: PathLike[str] | str) -> None:
    """Write the start record of a process of this service."""
    with open(os.path.join(own_folder(run_dir, STARTING_DIR), name), "w", encoding="ascii") as file:
        file.write(f"{pid} {start_ticks(pid)}\n")


def start_record(name: str, run_dir: PathLike[str] | str) -> tuple[int, int]:
    """pid and start in clock ticks of a process that was started for this service and has not joined yet.

    Both are 0 when none runs. A supervisor killed right after a start leaves a process that has no
    application file yet.
    """
    try:
        with open(os.path.join(run_dir, STARTING_DIR, name), encoding="ascii") as file:
            pid, started = map(int, file.read().split())
    except (OSError, ValueError):
        return 0, 0
    return (pid, started) if lives(pid, started) else (0, 0)


def starting_pid(name: str, run_dir: PathLike[str] | str) -> int:
    """pid of the process in the start record of this service, or 0 if no such process runs."""
    return start_record(name, run_dir)[0]


def clear_start_record(name: str, run_dir: PathLike[str] | str) -> None:
    """Remove the start record: the service has joined the node, or its process has ended."""
    remove_file(os.path.join(run_dir, STARTING_DIR, name))


def spawn_missing(
    name: str, config_dir: PathLike[str] | str, run_dir: PathLike[str] | str
) -> StartedProcess | None:
    """Start the service unless it runs or is being started by any process.

    Raises: OSError.
    """
    fd = os.open(own_folder(run_dir, STARTING_DIR), os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        if not lock_within(fd, LOCK_WAIT_S) or is_started(name, run_dir):
            return None
        return spawn(name, config_dir, run_dir)
    finally:
        os.close(fd)


def is_started(name: str, run_dir: PathLike[str] | str) -> bool:
    """Whether any process runs this service, or is being started for it."""
    return bool(starting_pid(name, run_dir)) or _joined(name, run_dir)


def _joined(name: str, run_dir: PathLike[str] | str) -> bool:
    """Whether its first instance holds its application file."""
    try:
        fd = open_shared(os.path.join(run_dir, "apps", f"{name}#1.toml"))
    except (OSError, WireError):  # it has no file: it has not joined, or has left
        return False
    try:
        return os.fstat(fd).st_uid in {0, os.stat(run_dir).st_uid} and held_by_other(fd)
    finally:
        os.close(fd)
