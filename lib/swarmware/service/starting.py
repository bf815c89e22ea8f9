"""Starts processes of services; a record of each stays until it has joined the node.

Forked by the fork server of the node, which holds nothing that a fork would keep, or started from scratch.
In a session of its own, so that a signal to the terminal or the end of the supervisor does not reach it.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress

from swarmware.service.fork import FOLDER as PARENT_FOLDER
from swarmware.service.fork import Started, ask, own_folder
from swarmware.shm.lock import held_by_other, lock_within
from swarmware.shm.ticks import start_ticks

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from os import PathLike
    from typing import Final

STARTING_DIR: Final = "starting"
"""In the run directory."""
PARENT_SOCKET: Final = "words"
"""Where the parent of the node's processes listens, in its folder; after a kill the next parent, too."""
BEAT_S: Final = 4.0
"""A process that speaks to the parent gives a sign of life twice in this time."""
GUARD: Final = "guard"
WHOLE_NODE: Final = ".node"
"""Record of the one process that runs all services; no service has such a name."""
LOCK_WAIT_S: Final = 2.0
"""A start takes some milliseconds; others wait for it to see whether they are still needed."""
_OURS: Final = frozenset({"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID", "MAINPID"})
"""Words between this process and its own supervisor."""


def launch(
    names: list[str], config_dir: PathLike[str] | str, run_dir: PathLike[str] | str, *, speaks: bool
) -> Started:
    """Starts a process of these services in a session of its own. Output goes where that of the node goes.

    `speaks`: it tells the parent of the node's processes that it is ready and alive, if there is one.
    """
    if (forked := ask(names, config_dir, run_dir, speaks=speaks)) is not None:
        return forked
    return Started(
        start(["run", *names, "--config", os.fspath(config_dir)], environment(run_dir, speaks=speaks))
    )


def start(words: list[str], variables: dict[str, str], stdin: int | None = None) -> int:
    """Starts `swarmd WORDS` with an empty interpreter; its pid."""
    null = (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0)
    # SIGINT and SIGTERM may be ignored or blocked here; a new process must not inherit that
    return os.posix_spawn(
        sys.executable,
        [sys.executable, "-m", "swarmd", *words],
        variables,
        file_actions=[null if stdin is None else (os.POSIX_SPAWN_DUP2, stdin, 0)],
        setsid=True,
        setsigmask=[],
        setsigdef=[signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGCHLD, signal.SIGPIPE],
    )


def environment(run_dir: PathLike[str] | str, *, speaks: bool) -> dict[str, str]:
    """Variables of a new process: ours, without the words between us and our own supervisor."""
    variables = {key: value for key, value in os.environ.items() if key not in _OURS}
    parent = os.path.join(run_dir, PARENT_FOLDER, PARENT_SOCKET)
    if speaks and os.path.exists(parent):
        variables["NOTIFY_SOCKET"] = parent
        variables["WATCHDOG_USEC"] = str(round(BEAT_S * 1e6))
    return variables


def spawn(name: str, config_dir: PathLike[str] | str, run_dir: PathLike[str] | str) -> Started:
    """Start the process of one service, and write its start record."""
    started = launch([name], config_dir, run_dir, speaks=name == GUARD)
    write_start_record(name, started.pid, run_dir)
    return started


def write_start_record(name: str, pid: int, run_dir: PathLike[str] | str) -> None:
    """Write the start record of a process of this service."""
    with open(os.path.join(own_folder(run_dir, STARTING_DIR), name), "w", encoding="ascii") as file:
        file.write(f"{pid} {start_ticks(pid)}\n")


def starting_pid(name: str, run_dir: PathLike[str] | str) -> int:
    """pid of a process that was started for this service, still runs and has not joined yet; 0: none.

    A supervisor killed right after a start leaves a process that has no application file yet.
    """
    try:
        with open(os.path.join(run_dir, STARTING_DIR, name), encoding="ascii") as file:
            pid, started = map(int, file.read().split())
    except (OSError, ValueError):
        return 0
    return pid if start_ticks(pid) == started != 0 else 0


def clear_start_record(name: str, run_dir: PathLike[str] | str) -> None:
    """Remove the start record: the service has joined the node, or its process has ended."""
    with suppress(FileNotFoundError):
        os.unlink(os.path.join(run_dir, STARTING_DIR, name))


def spawn_missing(name: str, config_dir: PathLike[str] | str, run_dir: PathLike[str] | str) -> Started | None:
    """Starts the service unless it runs or is being started, whoever else tries the same.

    Raises: OSError.
    """
    fd = os.open(own_folder(run_dir, STARTING_DIR), os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        if not lock_within(fd, LOCK_WAIT_S) or starting_pid(name, run_dir) or _joined(name, run_dir):
            return None
        return spawn(name, config_dir, run_dir)
    finally:
        os.close(fd)


def _joined(name: str, run_dir: PathLike[str] | str) -> bool:
    """Whether its first instance holds its application file."""
    try:
        fd = os.open(
            os.path.join(run_dir, "apps", f"{name}#1.toml"), os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW
        )
    except OSError:
        return False
    try:
        return held_by_other(fd)
    finally:
        os.close(fd)
