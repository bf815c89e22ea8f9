"""A process of a service as its supervisor sees it: started here or found running, its end told at once.

Spawned, never forked: a fork would keep the locks of its parent. In a session of its own, so that a signal
to the terminal or the end of the supervisor does not reach it.
"""

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from swarmware.errors import NotFound
from swarmware.shm.owner import start_ticks

BIRTHS = "births"
"""Folder in the run directory: who was started and may not have joined the node yet."""


class Child:
    """One process. `on_exit` is called once, with `signal 9`, `exit 1`, or `gone` for another's child."""

    def __init__(self, pid: int, on_exit: Callable[[str], None]) -> None:
        """Raises: NotFound when there is no such process."""
        try:
            self._fd = os.pidfd_open(pid)
        except ProcessLookupError:
            raise NotFound(f"process {pid}: it does not run") from None
        self.pid = pid
        self._on_exit = on_exit
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._ended)

    def signal(self, number: signal.Signals) -> None:
        """Sends a signal to this very process, never to a later one with its number."""
        if self._fd >= 0:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._fd, number)

    def _ended(self) -> None:
        how = "gone"
        with contextlib.suppress(
            ChildProcessError
        ):  # a child of another process: that one learns how it ended
            result = os.waitid(os.P_PIDFD, self._fd, os.WEXITED | os.WNOHANG)
            if result is not None:
                how = f"{'exit' if result.si_code == os.CLD_EXITED else 'signal'} {result.si_status}"
        self.close()
        self._on_exit(how)

    def close(self) -> None:
        """Watch it no more; it goes on."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1


def spawn(name: str, config_dir: Path, run_dir: Path) -> int:
    """Starts `swarmd run NAME` in a session of its own; its pid.

    Standard output and error go where ours go.
    """
    command = [sys.executable, "-m", "swarmd", "run", name, "--config", str(config_dir)]
    # SIGINT and SIGTERM may be ignored or blocked here; a new process must not inherit that
    pid = os.posix_spawn(
        sys.executable,
        command,
        {key: value for key, value in os.environ.items() if key not in _OURS},
        file_actions=[(os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0)],
        setsid=True,
        setsigmask=[],
        setsigdef=[signal.SIGTERM, signal.SIGINT, signal.SIGCHLD, signal.SIGPIPE],
    )
    folder = run_dir / BIRTHS
    folder.mkdir(mode=0o700, exist_ok=True)
    (folder / name).write_text(f"{pid} {start_ticks(pid)}\n", encoding="ascii")
    return pid


_OURS = frozenset({"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID", "MAINPID"})
"""Words between this process and its own supervisor."""


def newborn(name: str, run_dir: Path) -> int:
    """pid of a process that was started for this service and still runs; 0: none.

    A supervisor killed right after a start leaves a process that has no application file yet.
    """
    try:
        pid, started = map(int, (run_dir / BIRTHS / name).read_text("ascii").split())
    except (OSError, ValueError):
        return 0
    return pid if start_ticks(pid) == started != 0 else 0


def settled(name: str, run_dir: Path) -> None:
    """The service has joined the node, or its process has ended: the note of its start has served."""
    (run_dir / BIRTHS / name).unlink(missing_ok=True)
