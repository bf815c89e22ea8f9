"""Supervisors, which execute the actions of the guard: by processes, by systemd, or inside this process."""

import logging
from collections.abc import Callable
from typing import Protocol

from swarmware.errors import NotFound
from swarmware.node.node import Services
from swarmware.service.exit_status import ExitStatus
from swarmware.types.health import SupervisorKind

log = logging.getLogger("swarm.guard")

OnExit = Callable[[str, int, ExitStatus], None]
"""Name of the service, pid, and exit status of its process."""


class Supervisor(Protocol):
    """Starts, watches and ends services; never waits."""

    kind: SupervisorKind
    """Name of this kind of supervisor in the status board."""
    stops_services: bool
    """Whether the guard stops the services when it stops itself."""

    def starting_pid(self, name: str) -> int:
        """pid of a process of this service that has not joined the node yet; 0: none is known."""
        ...

    def spawn(self, name: str) -> int:
        """Start the service; its pid, or 0 when it is not known yet."""
        ...

    def watch(self, name: str, pid: int, started: int) -> bool:
        """Call `on_exit` when this process ends; False when it has ended already.

        `started`: its start in clock ticks, by its application file; 0: it has none.
        """
        ...

    def joined(self, name: str) -> None:
        """Remove the start record: the service has joined the node."""
        ...

    def terminate(self, name: str, pid: int) -> None:
        """Request the service to end."""
        ...

    def stop(self, name: str, pid: int) -> None:
        """Request the service to end, and not to be started again before `spawn`."""
        ...

    def stays_stopped(self, name: str) -> bool:
        """Whether a service that an earlier guard stopped is still prevented from running."""
        ...

    def kill(self, name: str, pid: int) -> None:
        """Kill the process of a service."""
        ...

    def close(self) -> None:
        """Stop watching the processes of services."""
        ...


class InProcessSupervisor:
    """Restarts, stops and starts services that run as tasks in the process of the guard."""

    kind = SupervisorKind.RUNNER
    stops_services = False

    def __init__(self, host: Services, on_exit: OnExit) -> None:
        self._host = host
        self._on_exit = on_exit

    def starting_pid(self, name: str) -> int:
        """Return 0: the runner of the process has started every service."""
        return 0

    def spawn(self, name: str) -> int:
        """Let the runner of the process start the service, if it was stopped; return 0."""
        self._host.release(name)
        return 0

    def watch(self, name: str, pid: int, started: int) -> bool:
        """Return True: the services end with this process."""
        return True

    def joined(self, name: str) -> None:
        """Do nothing: the service has no process of its own."""

    def terminate(self, name: str, pid: int) -> None:
        """Cancel the task of the service, which is then started again."""
        try:
            self._host.restart(name)
        except NotFound as error:
            log.warning("%s", error)

    def stop(self, name: str, pid: int) -> None:
        """Stop the task of the service, which is not started again before `spawn`."""
        self._host.halt(name, lambda: self._on_exit(name, pid, ExitStatus()))

    def stays_stopped(self, name: str) -> bool:
        """Whether this process stopped it: a new process has started all services."""
        return self._host.halted(name)

    def kill(self, name: str, pid: int) -> None:
        """Cancel the task of the service: a task cannot be killed."""
        self.terminate(name, pid)

    def close(self) -> None:
        """Do nothing: no process is watched."""
