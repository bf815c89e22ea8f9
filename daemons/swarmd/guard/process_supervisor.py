"""Supervisors of services that have a process each, started by the guard or by systemd."""

import asyncio
import logging
import signal
from contextlib import suppress
from pathlib import Path

from swarmd.guard.supervisor import OnExit
from swarmware.errors import NotFound
from swarmware.service.exit_status import ExitStatus
from swarmware.service.fork_client import StartedProcess
from swarmware.service.starting import clear_start_record, spawn, start_record, starting_pid
from swarmware.service.supervised_process import SupervisedProcess
from swarmware.types.health import SupervisorKind

log = logging.getLogger("swarm.guard")


class ProcessSupervisor:
    """Starts services as processes, through the fork server if there is one."""

    kind = SupervisorKind.SELF
    stops_services = True

    def __init__(self, config_dir: Path, run_dir: Path, on_exit: OnExit) -> None:
        self._config_dir = config_dir
        self._run_dir = run_dir
        self._on_exit = on_exit
        self._children: dict[str, SupervisedProcess] = {}
        self._started: dict[str, StartedProcess] = {}
        """Started processes that are not watched yet."""

    def starting_pid(self, name: str) -> int:
        """Returns the pid of a process that a previous guard started and that has not joined the node yet."""
        return starting_pid(name, self._run_dir)

    def spawn(self, name: str) -> int:
        """Starts a new process of the service; returns its pid."""
        started = self._started[name] = spawn(name, self._config_dir, self._run_dir)
        return started.pid

    def watch(self, name: str, pid: int, started: int) -> bool:
        """Watches the process by pidfd, which reports its end within milliseconds; returns False if it has
        ended."""
        if (known := self._children.pop(name, None)) is not None:
            known.close()
        process = self._started.pop(name, None)
        if process is None or process.pid != pid:
            recorded = start_record(name, self._run_dir)
            # without its start time the pid may belong to another process by now
            if not started and recorded[0] != pid:
                return False
            process = StartedProcess(pid, started=started or recorded[1])
        with suppress(NotFound):
            self._children[name] = SupervisedProcess(process, lambda how: self._ended(name, pid, how))
            return True
        return False

    def _ended(self, name: str, pid: int, how: ExitStatus) -> None:
        self._children.pop(name, None)
        clear_start_record(name, self._run_dir)
        self._on_exit(name, pid, how)

    def joined(self, name: str) -> None:
        """Removes the start record, because the application file now identifies the process."""
        clear_start_record(name, self._run_dir)

    def terminate(self, name: str, pid: int) -> None:
        """Sends SIGTERM to the process of a service."""
        self._signal(name, pid, signal.SIGTERM)

    def stop(self, name: str, pid: int) -> None:
        """Sends SIGTERM to the process of a service, which only `spawn` starts again."""
        self.terminate(name, pid)

    def stays_stopped(self, name: str) -> bool:
        """Returns True, because only the guard starts services."""
        return True

    def kill(self, name: str, pid: int) -> None:
        """Sends SIGKILL, which also ends a process that SIGSTOP has stopped."""
        self._signal(name, pid, signal.SIGKILL)

    def _signal(self, name: str, pid: int, number: signal.Signals) -> None:
        child = self._children.get(name)
        if child is not None and child.pid == pid:
            child.signal(number)

    def close(self) -> None:
        """Closes the pidfds; the processes continue."""
        for child in self._children.values():
            child.close()
        self._children.clear()


class SystemdSupervisor(ProcessSupervisor):
    """Requests restarts from systemd, which runs each service as a unit."""

    kind = SupervisorKind.SYSTEMD
    stops_services = False

    def __init__(
        self, config_dir: Path, run_dir: Path, on_exit: OnExit, systemctl: str = "systemctl"
    ) -> None:
        super().__init__(config_dir, run_dir, on_exit)
        self._systemctl = systemctl
        self._calls: set[asyncio.Task[None]] = set()

    def starting_pid(self, name: str) -> int:
        """Returns 0, because systemd tracks the processes that it starts."""
        return 0

    def spawn(self, name: str) -> int:
        """Returns 0, because systemd starts the process; `kill` restarts a unit that does not join in
        time."""
        return 0

    def terminate(self, name: str, pid: int) -> None:
        """Requests a restart of the unit."""
        self._call("restart", f"swarmd@{name}.service")

    def kill(self, name: str, pid: int) -> None:
        """Kills the process, which systemd then restarts; requests a restart if no process is known."""
        if pid:
            super().kill(name, pid)
        else:
            self.terminate(name, pid)

    def _call(self, *words: str) -> None:
        # the guard must not wait for systemd, and a task without a reference may be garbage-collected
        task = asyncio.get_running_loop().create_task(self._run(*words), name=f"systemctl {words[0]}")
        self._calls.add(task)
        task.add_done_callback(self._calls.discard)

    async def _run(self, *words: str) -> None:
        try:
            process = await asyncio.create_subprocess_exec(
                self._systemctl,
                "--no-block",
                "--no-ask-password",
                *words,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
            )
        except OSError as error:
            log.error("systemctl: cannot be run: %s", error)
            return
        _, errors = await process.communicate()
        if process.returncode:
            log.error("systemctl %s: %s", " ".join(words), errors.decode(errors="replace").strip())

    def close(self) -> None:
        """Cancels the pending calls of systemctl, and closes the pidfds."""
        for task in self._calls:
            task.cancel()
        super().close()
