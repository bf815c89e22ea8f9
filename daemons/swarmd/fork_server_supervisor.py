"""Supervisor of the node's fork server, which starts it first and restarts it when it is killed."""

from __future__ import annotations

import os
import time

from swarmware.footprint.annotations import Final
from swarmware.footprint.plain import signal
from swarmware.runtime.backoff import RestartPolicy
from swarmware.runtime.pidfd import ProcessHandle
from swarmware.service.fork_client import FOLDER, SOCKET
from swarmware.service.notify import remove_file
from swarmware.service.starting import environment, start

_NS: Final = 1_000_000_000


class ForkServerSupervisor:
    """Starts and restarts the fork server; without it the node works, but processes start more slowly."""

    def __init__(self, services: list[str], run_dir: str) -> None:
        self._path = os.path.join(run_dir, FOLDER, SOCKET)
        self._command = ["forkserver", *services, "--socket", self._path]
        self._run_dir = run_dir
        self._restart_policy = RestartPolicy()
        self._lifeline = -1
        self.pid = 0
        self._process: ProcessHandle | None = None
        self.due_ns: int | None = None
        """Instant of the next restart, or None while the fork server runs or after it was given up."""

    def begin(self) -> None:
        """Starts the fork server. Raises: OSError."""
        self.due_ns = None
        theirs, self._lifeline = os.pipe()  # its stdin: the kernel closes the pipe when this process ends
        try:
            self.pid = start(self._command, environment(self._run_dir, notifies=True), stdin=theirs)
        finally:
            os.close(theirs)
        self._process = ProcessHandle(self.pid)

    def fileno(self) -> int:
        """Descriptor that becomes readable when the fork server ends, or -1 while it does not run."""
        return -1 if self._process is None else self._process.fileno()

    def on_ready(self) -> None:
        """Takes that the fork server has reported READY."""
        self._restart_policy.on_ready(time.monotonic_ns())

    def on_end(self) -> None:
        """Takes the end of the fork server, and schedules its restart."""
        how = os.waitid(os.P_PID, self.pid, os.WEXITED)
        killed = how is not None and how.si_code != os.CLD_EXITED
        self._forget()
        now_ns = time.monotonic_ns()
        pause_s = self._restart_policy.on_end(now_ns, killed=killed)
        self.due_ns = None if pause_s is None else now_ns + round(pause_s * _NS)

    def close(self) -> None:
        """Kills the fork server, which has no state to save."""
        self.due_ns = None
        if self.pid:
            if self._process is not None:
                self._process.signal(signal.SIGKILL)
            os.waitid(os.P_PID, self.pid, os.WEXITED)
            self._forget()
        remove_file(self._path)

    def _forget(self) -> None:
        if self._process is not None:
            self._process.close()
        os.close(self._lifeline)
        self.pid, self._process, self._lifeline = 0, None, -1
