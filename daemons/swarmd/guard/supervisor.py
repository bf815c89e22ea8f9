"""Supervisors, which execute the guard's actions with processes, with systemd, or inside this process."""

import logging
from collections.abc import Callable
from typing import Protocol

from swarmware.errors import NotFound
from swarmware.node.node import Services
from swarmware.service.exit_status import ExitStatus
from swarmware.types.health import SupervisorKind

log = logging.getLogger("swarm.guard")

OnExit = Callable[[str, int, ExitStatus], None]
"""Callback with the name of the service, the pid, and the exit status of its process."""


class Supervisor(Protocol):
    """Starts, watches and ends services; never waits."""

    kind: SupervisorKind
    """Name of this kind of supervisor in the status board."""
    stops_services: bool
    """True if the guard stops the services when it stops itself."""

    def starting_pid(self, name: str) -> int:
        """Returns the pid of a process that has not joined the node yet, or 0 if none is known."""
        ...

    def spawn(self, name: str) -> int:
        """Starts the service; returns its pid, or 0 if it is not known yet."""
        ...

    def watch(self, name: str, pid: int, started: int) -> bool:
        """Calls `on_exit` when this process ends; returns False if it has ended already.

        `started`: start of the process in clock ticks, or 0 if it has no application file.
        """
        ...

    def joined(self, name: str) -> None:
        """Removes the start record of a service that has joined the node."""
        ...

    def terminate(self, name: str, pid: int) -> None:
        """Requests the service to end."""
        ...

    def stop(self, name: str, pid: int) -> None:
        """Requests the service to end, and prevents its restart before `spawn`."""
        ...

    def stays_stopped(self, name: str) -> bool:
        """True if a service that a previous guard stopped is still prevented from running."""
        ...

    def kill(self, name: str, pid: int) -> None:
        """Kills the process of a service."""
        ...

    def close(self) -> None:
        """Stops watching the processes of services."""
        ...


class InProcessSupervisor:
    """Restarts, stops and starts services that run as tasks in the process of the guard."""

    kind = SupervisorKind.RUNNER
    stops_services = False

    def __init__(self, host: Services, on_exit: OnExit) -> None:
        self._host = host
        self._on_exit = on_exit

    def starting_pid(self, name: str) -> int:
        """Returns 0, because the runner of the process has started every service."""
        return 0

    def spawn(self, name: str) -> int:
        """Lets the runner of the process start the service, if it was stopped; returns 0."""
        self._host.release(name)
        return 0

    def watch(self, name: str, pid: int, started: int) -> bool:
        """Returns True, because the services end only with this process."""
        return True

    def joined(self, name: str) -> None:
        """Does nothing, because the service has no process of its own."""

    def terminate(self, name: str, pid: int) -> None:
        """Cancels the task of the service, which is then started again."""
        try:
            self._host.restart(name)
        except NotFound as error:
            log.warning("%s", error)

    def stop(self, name: str, pid: int) -> None:
        """Stops the task of the service, which is not started again before `spawn`."""
        self._host.halt(name, lambda: self._on_exit(name, pid, ExitStatus()))

    def stays_stopped(self, name: str) -> bool:
        """True if this process has stopped the service; a new process starts all services."""
        return self._host.halted(name)

    def kill(self, name: str, pid: int) -> None:
        """Cancels the task of the service, because a task cannot be killed."""
        self.terminate(name, pid)

    def close(self) -> None:
        """Does nothing, because no process is watched."""
