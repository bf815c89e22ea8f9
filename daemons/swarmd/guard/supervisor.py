"""Who carries out what the guard decides: the guard itself, systemd, or the runner of this process."""

import asyncio
import logging
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from swarmware.errors import NotFound
from swarmware.service.child import Child
from swarmware.service.fork import Started
from swarmware.service.starting import clear_start_record, spawn, starting_pid

log = logging.getLogger("swarm.guard")

OnExit = Callable[[str, int, str], None]
"""Name, pid and how it ended."""


class Supervisor(Protocol):
    """Starts, watches and ends services; never waits."""

    kind: str
    """What the status board says."""
    stops: bool
    """Whether the end of the guard is the end of the services."""

    def running(self, name: str) -> int:
        """pid of a process of this service that has not joined the node yet; 0: none is known."""
        ...

    def spawn(self, name: str) -> int:
        """Start the service; its pid, or 0 when it is not known yet."""
        ...

    def watch(self, name: str, pid: int) -> bool:
        """Tell of the end of this process; False when it has ended already."""
        ...

    def joined(self, name: str) -> None:
        """The service has joined the node."""
        ...

    def ask(self, name: str, pid: int) -> None:
        """Ask the service to end."""
        ...

    def kill(self, name: str, pid: int) -> None:
        """End it at once."""
        ...

    def close(self) -> None:
        """Watch no more."""
        ...


class Processes:
    """Services are processes that the guard starts itself."""

    kind = "self"
    stops = True

    def __init__(self, config_dir: Path, run_dir: Path, on_exit: OnExit) -> None:
        self._config_dir = config_dir
        self._run_dir = run_dir
        self._on_exit = on_exit
        self._children: dict[str, Child] = {}
        self._started: dict[str, Started] = {}
        """Until they are watched."""

    def running(self, name: str) -> int:
        """pid of a process that a former guard started a moment ago."""
        return starting_pid(name, self._run_dir)

    def spawn(self, name: str) -> int:
        """A new process in a session of its own."""
        started = self._started[name] = spawn(name, self._config_dir, self._run_dir)
        return started.pid

    def watch(self, name: str, pid: int) -> bool:
        """By pidfd: its end is known within milliseconds."""
        if (known := self._children.pop(name, None)) is not None:
            known.close()
        started = self._started.pop(name, None)
        if started is None or started.pid != pid:
            started = Started(pid)
        with suppress(NotFound):
            self._children[name] = Child(started, lambda how: self._ended(name, pid, how))
            return True
        return False

    def _ended(self, name: str, pid: int, how: str) -> None:
        self._children.pop(name, None)
        clear_start_record(name, self._run_dir)
        self._on_exit(name, pid, how)

    def joined(self, name: str) -> None:
        """Its application file says it from now on."""
        clear_start_record(name, self._run_dir)

    def ask(self, name: str, pid: int) -> None:
        """SIGTERM."""
        self._signal(name, pid, signal.SIGTERM)

    def kill(self, name: str, pid: int) -> None:
        """SIGKILL, which also ends a stopped process."""
        self._signal(name, pid, signal.SIGKILL)

    def _signal(self, name: str, pid: int, number: signal.Signals) -> None:
        child = self._children.get(name)
        if child is not None and child.pid == pid:
            child.signal(number)

    def close(self) -> None:
        """The processes go on."""
        for child in self._children.values():
            child.close()
        self._children.clear()


class Systemd(Processes):
    """Services are units of systemd: it is asked; what it does by itself is only watched."""

    kind = "systemd"
    stops = False

    def __init__(
        self, config_dir: Path, run_dir: Path, on_exit: OnExit, systemctl: str = "systemctl"
    ) -> None:
        super().__init__(config_dir, run_dir, on_exit)
        self._systemctl = systemctl
        self._calls: set[asyncio.Task[None]] = set()

    def running(self, name: str) -> int:
        """systemd knows by itself what it has started."""
        return 0

    def spawn(self, name: str) -> int:
        """systemd does it; one that does not come back in time is restarted by `kill`."""
        return 0

    def ask(self, name: str, pid: int) -> None:
        """A restart: it is asked to end, and started again."""
        self._call("restart", f"swarmd@{name}.service")

    def kill(self, name: str, pid: int) -> None:
        """systemd sees the failure and starts it again; what has no process is restarted on request."""
        if pid:
            super().kill(name, pid)
        else:
            self.ask(name, pid)

    def _call(self, *words: str) -> None:
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
        """Calls in work are cut."""
        for task in self._calls:
            task.cancel()
        super().close()


class Runner:
    """Services share this process: its runner starts one again that has failed, and on request."""

    kind = "runner"
    stops = False

    def __init__(self, restart: Callable[[str], None]) -> None:
        self._restart = restart

    def running(self, name: str) -> int:
        """The runner has started them all."""
        return 0

    def spawn(self, name: str) -> int:
        """The runner does it."""
        return 0

    def watch(self, name: str, pid: int) -> bool:
        """They live as long as we do."""
        return True

    def joined(self, name: str) -> None:
        """Nothing to be done."""

    def ask(self, name: str, pid: int) -> None:
        """Cancelled and started again."""
        try:
            self._restart(name)
        except NotFound as error:
            log.warning("%s", error)

    def kill(self, name: str, pid: int) -> None:
        """Nothing stronger can be done to a task than to cancel it."""
        self.ask(name, pid)

    def close(self) -> None:
        """Nothing to be done."""
