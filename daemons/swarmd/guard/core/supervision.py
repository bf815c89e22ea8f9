"""Supervision of services: decides the start, kill, restart, giving up and stop of each service."""

from collections.abc import Container
from enum import StrEnum
from typing import Final

import msgspec

from swarmd.guard.config import Config
from swarmware.errors import Denied
from swarmware.runtime.backoff import RestartPolicy
from swarmware.service.exit_status import ExitStatus
from swarmware.types.health import GuardStatus, ServiceState, SupervisorKind, WatchedService

HEARTBEAT_NS: Final = 1_000_000_000
"""Period of reading heartbeats, equal to the period of writing them; shared with other periodic work."""


class ServiceEvent(StrEnum):
    """Event of a supervised service."""

    SPAWN = "spawn"
    ADOPT = "adopt"
    JOINED = "joined"
    EXIT = "exit"
    GIVE_UP = "give up"
    STOP = "stop"


TRANSITIONS: Final[dict[tuple[ServiceState, ServiceEvent], ServiceState]] = {
    (ServiceState.WAITING, ServiceEvent.SPAWN): ServiceState.STARTING,
    (ServiceState.WAITING, ServiceEvent.ADOPT): ServiceState.RUNNING,
    (ServiceState.WAITING, ServiceEvent.STOP): ServiceState.STOPPED,
    (ServiceState.STARTING, ServiceEvent.JOINED): ServiceState.RUNNING,
    (ServiceState.STARTING, ServiceEvent.EXIT): ServiceState.BACK_OFF,
    (ServiceState.STARTING, ServiceEvent.STOP): ServiceState.STOPPING,
    (ServiceState.RUNNING, ServiceEvent.EXIT): ServiceState.BACK_OFF,
    (ServiceState.RUNNING, ServiceEvent.STOP): ServiceState.STOPPING,
    (ServiceState.BACK_OFF, ServiceEvent.SPAWN): ServiceState.STARTING,
    (ServiceState.BACK_OFF, ServiceEvent.ADOPT): ServiceState.RUNNING,
    (ServiceState.BACK_OFF, ServiceEvent.GIVE_UP): ServiceState.FAILED,
    (ServiceState.BACK_OFF, ServiceEvent.STOP): ServiceState.STOPPED,
    (ServiceState.FAILED, ServiceEvent.SPAWN): ServiceState.STARTING,
    (ServiceState.FAILED, ServiceEvent.ADOPT): ServiceState.RUNNING,
    (ServiceState.FAILED, ServiceEvent.STOP): ServiceState.STOPPED,
    (ServiceState.STOPPING, ServiceEvent.EXIT): ServiceState.STOPPED,
    (ServiceState.STOPPED, ServiceEvent.SPAWN): ServiceState.STARTING,
}


class Spawn(msgspec.Struct, frozen=True):
    """Action: start the process of a service."""

    service: str


class Kill(msgspec.Struct, frozen=True):
    """Action: kill the process of a service that is hung, or did not end when requested."""

    service: str
    pid: int
    reason: str


class Terminate(msgspec.Struct, frozen=True):
    """Action: request the process of a service to end."""

    service: str
    pid: int


class Stop(msgspec.Struct, frozen=True):
    """Action: stop a service that must not be restarted automatically."""

    service: str
    pid: int


class ReportRestart(msgspec.Struct, frozen=True):
    """Action: publish that a service was restarted or given up."""

    service: WatchedService


class WatchProcess(msgspec.Struct, frozen=True):
    """Action: report the end of this process of a service to `on_exit`."""

    service: str
    pid: int


class ClearStartRecord(msgspec.Struct, frozen=True):
    """Action: remove the start record of a service that has joined the node."""

    service: str


class ReadHeartbeats(msgspec.Struct, frozen=True):
    """Action: read application files and heartbeats, call their events, then `on_heartbeats_read`."""


Action = Spawn | Kill | Terminate | Stop | ReportRestart | WatchProcess | ClearStartRecord | ReadHeartbeats


class SupervisedService(msgspec.Struct):
    """One service under the guard."""

    name: str
    policy: RestartPolicy
    state: ServiceState = ServiceState.WAITING
    pid: int = 0
    restarts: int = 0
    since_ns: int = 0
    adopted: bool = False
    reason: str = ""
    beat: int = -1
    deadline_ns: int | None = None
    """Deadline of the present state: to join (starting), for a heartbeat (running), of the next start
    (back-off), or to end before the kill (stopping)."""
    ran_before: bool = False
    """True if the service was running under the previous guard."""
    kill_reason: str = ""
    """Reason why the guard ended the process, reported with its exit."""
    stopped_by: str = ""
    """Operator who stopped the service, or "" if no operator did."""

    def transition(self, event: ServiceEvent, now_ns: int) -> None:
        """Changes the state by the table of transitions."""
        self.state = TRANSITIONS[self.state, event]
        self.since_ns = now_ns
        self.deadline_ns = None

    def status(self) -> WatchedService:
        """State of the service, for the status board and the events."""
        return WatchedService(
            self.name,
            self.state,
            self.pid,
            self.restarts,
            self.since_ns,
            self.adopted,
            self.reason,
            self.stopped_by,
        )


def exit_reason(how: ExitStatus) -> str:
    """Reason of a restart, with the exit status if this process is the parent and knows it."""
    return f"died: {how}" if how.known else "died"


class GuardCore:
    """Supervises services: starts them in order, stops them in the reverse order."""

    def __init__(
        self,
        services: tuple[str, ...],
        supervisor: SupervisorKind,
        config: Config,
    ) -> None:
        self._services = {
            name: SupervisedService(
                name,
                RestartPolicy(
                    pauses_s=config.back_off_s, settled_s=config.settled_s, limit=config.restart_limit
                ),
            )
            for name in services
        }
        self._supervisor = supervisor
        self._hung_ns = round(config.hung_s * 1e9)
        self._start_ns = round(config.start_s * 1e9)
        self._limit = config.restart_limit
        self._stop_ns = round(config.stop_s * 1e9)
        self._stopping: list[str] | None = None
        self._next_read_ns: int | None = None
        """Instant of the next reading of heartbeats."""

    def __contains__(self, name: str) -> bool:
        return name in self._services

    @property
    def stopped(self) -> bool:
        """True if every service has stopped after `on_stop`."""
        return self._stopping is not None and all(
            watched.state is ServiceState.STOPPED for watched in self._services.values()
        )

    def status(self) -> GuardStatus:
        """Status of all services."""
        services = tuple(watched.status() for watched in self._services.values())
        return GuardStatus(self._supervisor, services, sum(watched.restarts for watched in services))

    def restore(self, before: GuardStatus, may_be_stopped: Container[str] = ()) -> None:
        """Restores the counters and the stopped services from the status board of a killed guard."""
        for old in before.services:
            if (watched := self._services.get(old.name)) is not None:
                watched.restarts = old.restarts
                watched.reason = old.reason
                watched.ran_before = old.state == ServiceState.RUNNING
                watched.stopped_by = old.stopped_by if old.name in may_be_stopped else ""

    # -- events

    def on_start(self, running: dict[str, int], starting: dict[str, int], now_ns: int) -> list[Action]:
        """Adopts running services (pid by name), waits for starting services, and starts the other ones."""
        self._next_read_ns = now_ns
        actions: list[Action] = []
        for watched in self._services.values():
            if watched.name in running:
                actions += self._adopt(watched, running[watched.name], now_ns)
                if watched.stopped_by:  # the previous guard was killed before the service had ended
                    actions += self.on_stop_order(watched.name, watched.stopped_by, now_ns)
                continue
            if watched.stopped_by:
                watched.transition(ServiceEvent.STOP, now_ns)
                continue
            spawn = self._spawn(watched, now_ns)
            if watched.name in starting:
                watched.pid = starting[watched.name]
                watched.adopted = True
                actions.append(WatchProcess(watched.name, watched.pid))
                continue
            if watched.ran_before:
                watched.restarts += 1
                watched.reason = "died while no guard ran"
                actions.append(ReportRestart(watched.status()))
            actions.append(spawn)
        return actions

    def on_spawned(self, name: str, pid: int, now_ns: int) -> list[Action]:
        """Takes the pid of a started process, or 0 if the supervisor does not report it."""
        self._services[name].pid = pid
        return [WatchProcess(name, pid)] if pid else []

    def on_joined(self, name: str, pid: int, now_ns: int) -> list[Action]:
        """Takes that a living process has joined the node as this service, whatever supervisor started it."""
        watched = self._services[name]
        if watched.state is ServiceState.STARTING and watched.pid in {pid, 0}:
            watched.transition(ServiceEvent.JOINED, now_ns)
            followed, watched.pid = watched.pid, pid
            self._expect_heartbeat(watched, now_ns)
            return [ClearStartRecord(name)] if followed else [ClearStartRecord(name), WatchProcess(name, pid)]
        # a process that another supervisor or an operator has started
        if (watched.state, ServiceEvent.ADOPT) in TRANSITIONS and watched.state is not ServiceState.WAITING:
            return self._adopt(watched, pid, now_ns)
        return []

    def on_heartbeat(self, name: str, beat: int, now_ns: int) -> list[Action]:
        """Takes the count on the service's status board; only a changed count is a heartbeat."""
        watched = self._services[name]
        # heartbeats of a process that is to restart must not postpone its kill
        if watched.state is ServiceState.RUNNING and beat != watched.beat and not watched.kill_reason:
            watched.beat = beat
            self._expect_heartbeat(watched, now_ns)
        return []

    def on_restarted(self, name: str, restarts: int, now_ns: int) -> list[Action]:
        """Takes the number of times that the runner of the process has restarted the service."""
        watched = self._services[name]
        if watched.state is not ServiceState.RUNNING or restarts <= watched.restarts:
            return []
        watched.restarts = restarts
        watched.reason, watched.kill_reason = watched.kill_reason or "failed", ""
        watched.since_ns = now_ns
        self._expect_heartbeat(watched, now_ns)
        return [ReportRestart(watched.status())]

    def on_exit(self, name: str, pid: int, how: ExitStatus, now_ns: int) -> list[Action]:
        """Takes the end of a process; `how` is its exit status, as far as it is known."""
        watched = self._services[name]
        if watched.pid != pid or (watched.state, ServiceEvent.EXIT) not in TRANSITIONS:
            return []
        if watched.state is ServiceState.RUNNING:
            watched.policy.on_ready(watched.since_ns)
        watched.transition(ServiceEvent.EXIT, now_ns)
        watched.pid = 0
        if watched.stopped_by and self._stopping is None:
            if watched.state is not ServiceState.STOPPED:
                watched.transition(ServiceEvent.STOP, now_ns)
            return []
        if self._stopping is not None:
            if (watched.state, ServiceEvent.STOP) in TRANSITIONS:
                watched.transition(ServiceEvent.STOP, now_ns)  # ended before it was requested to end
            return self._stop_next(now_ns)
        killed_here = bool(watched.kill_reason)
        watched.reason, watched.kill_reason = watched.kill_reason or exit_reason(how), ""
        # a kill by the guard counts as a failure of the service, a kill by another process does not
        pause_s = watched.policy.on_end(now_ns, killed=how.killed and not killed_here)
        if pause_s is None:
            watched.transition(ServiceEvent.GIVE_UP, now_ns)
            watched.reason += f"; given up after {self._limit} restarts in a row"
            return [ReportRestart(watched.status())]
        watched.deadline_ns = now_ns + round(pause_s * 1e9)
        watched.restarts += 1
        actions: list[Action] = [ReportRestart(watched.status())]
        return actions + self._due(watched, now_ns)

    def on_restart_order(self, name: str, now_ns: int) -> list[Action]:
        """Restarts a service at an operator's request, even if the service was given up."""
        watched = self._services[name]
        if self._stopping is not None:
            return []
        if watched.state is ServiceState.STOPPING:
            return []  # the operator can start the service when it has ended
        watched.policy.reset()
        watched.stopped_by = ""
        if watched.state in {ServiceState.RUNNING, ServiceState.STARTING}:
            watched.kill_reason = "restarted on request"
            watched.deadline_ns = now_ns + self._stop_ns
            watched.beat = -1
            return [Terminate(name, watched.pid)]
        if watched.state in {ServiceState.FAILED, ServiceState.BACK_OFF, ServiceState.STOPPED}:
            watched.reason = "restarted on request"
            watched.restarts += 1
            return [self._spawn(watched, now_ns)]
        return []

    def on_stop_order(self, name: str, by: str, now_ns: int) -> list[Action]:
        """Stops a service at an operator's request, until `on_start_order` or the next start of the node.

        Raises: Denied for a service that cannot be stopped.
        """
        if why := self.status().why_not_stopped(name):
            raise Denied(why)
        watched = self._services[name]
        if self._stopping is not None or watched.state in {ServiceState.STOPPING, ServiceState.STOPPED}:
            return []
        watched.stopped_by = by
        running = watched.state in {ServiceState.RUNNING, ServiceState.STARTING}
        watched.transition(ServiceEvent.STOP, now_ns)
        if not running:
            return []
        watched.kill_reason = ""
        watched.deadline_ns = now_ns + self._stop_ns
        return [Stop(name, watched.pid)]

    def on_start_order(self, name: str, now_ns: int) -> list[Action]:
        """Starts a stopped or given-up service at an operator's request; a running service is left alone.

        Raises: Denied while the service is still being stopped.
        """
        watched = self._services[name]
        if watched.state is ServiceState.STOPPING:
            raise Denied(
                f"service {name!r}: still being stopped; expected its end, within {self._stop_ns / 1e9:g} s"
            )
        if self._stopping is not None or watched.state not in {ServiceState.STOPPED, ServiceState.FAILED}:
            return []
        watched.policy.reset()
        watched.stopped_by = ""
        return [self._spawn(watched, now_ns)]

    def on_stop(self, now_ns: int) -> list[Action]:
        """Stops all services one after the other, in the reverse order of their start."""
        if self._stopping is not None:
            return []
        self._stopping = list(reversed(self._services))
        for watched in self._services.values():
            if watched.state in {ServiceState.WAITING, ServiceState.BACK_OFF, ServiceState.FAILED}:
                watched.transition(ServiceEvent.STOP, now_ns)
        return self._stop_next(now_ns)

    def deadline_ns(self) -> int | None:
        """Instant of the next call of `on_timer`, or None when all services have stopped."""
        if self.stopped or self._next_read_ns is None:
            return None
        deadline_ns = self._service_deadline_ns()
        return self._next_read_ns if deadline_ns is None else min(self._next_read_ns, deadline_ns)

    def _service_deadline_ns(self) -> int | None:
        return min(
            (watched.deadline_ns for watched in self._services.values() if watched.deadline_ns is not None),
            default=None,
        )

    def on_timer(self, now_ns: int) -> list[Action]:
        """Requests the heartbeats, once a second and at each deadline of a service."""
        if self._next_read_ns is not None and self._next_read_ns <= now_ns:
            self._next_read_ns = (now_ns // HEARTBEAT_NS + 1) * HEARTBEAT_NS
        return [ReadHeartbeats()]

    def on_heartbeats_read(self, now_ns: int) -> list[Action]:
        """Handles expired deadlines: starts services after a back-off, kills services that hang or do not
        end.

        A delay of the guard itself extends the deadlines, because silence in that time is not a failure.
        """
        deadline_ns = self._service_deadline_ns()
        late_ns = now_ns - deadline_ns if deadline_ns is not None else 0
        if late_ns > self._hung_ns // 2:
            for watched in self._services.values():
                if watched.deadline_ns is not None and watched.state is not ServiceState.BACK_OFF:
                    watched.deadline_ns += late_ns + self._hung_ns // 2
        actions: list[Action] = []
        for watched in self._services.values():
            actions += self._due(watched, now_ns)
        return actions

    # -- actions

    def _due(self, watched: SupervisedService, now_ns: int) -> list[Action]:
        if watched.deadline_ns is None or watched.deadline_ns > now_ns:
            return []
        silent_s = (now_ns - watched.deadline_ns + self._hung_ns) / 1e9
        match watched.state:
            case ServiceState.BACK_OFF:
                return [self._spawn(watched, now_ns)]
            case ServiceState.STARTING:
                reason = f"hung: not on the node {self._start_ns / 1e9:g} s after its start"
            case ServiceState.RUNNING:
                reason = f"hung: no beat for {silent_s:.1f} s"
            case _:
                reason = "did not end when requested"
        return self._kill(watched, reason, now_ns)

    def _kill(self, watched: SupervisedService, reason: str, now_ns: int) -> list[Action]:
        watched.kill_reason = watched.kill_reason or reason
        watched.deadline_ns = now_ns + self._start_ns
        return [Kill(watched.name, watched.pid, watched.kill_reason)]

    def _spawn(self, watched: SupervisedService, now_ns: int) -> Spawn:
        watched.transition(ServiceEvent.SPAWN, now_ns)
        watched.adopted = False
        watched.pid = 0
        watched.beat = -1
        watched.deadline_ns = now_ns + self._start_ns
        return Spawn(watched.name)

    def _adopt(self, watched: SupervisedService, pid: int, now_ns: int) -> list[Action]:
        watched.transition(ServiceEvent.ADOPT, now_ns)
        watched.adopted = True
        watched.pid = pid
        self._expect_heartbeat(watched, now_ns)
        return [ClearStartRecord(watched.name), WatchProcess(watched.name, pid)]

    def _expect_heartbeat(self, watched: SupervisedService, now_ns: int) -> None:
        watched.deadline_ns = now_ns + self._hung_ns

    def _stop_next(self, now_ns: int) -> list[Action]:
        actions: list[Action] = []
        while self._stopping:
            watched = self._services[self._stopping[0]]
            if watched.state is ServiceState.STOPPING:
                break
            if watched.state is not ServiceState.STOPPED:
                watched.transition(ServiceEvent.STOP, now_ns)
                watched.deadline_ns = now_ns + self._stop_ns
                actions.append(Terminate(watched.name, watched.pid))
                break
            self._stopping.pop(0)
        return actions
