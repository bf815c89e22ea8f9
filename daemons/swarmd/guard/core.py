"""What the guard decides: which service is started, killed, tried again, given up, stopped, and when."""

from enum import StrEnum
from typing import Final

import msgspec

from swarmd.guard.config import Config
from swarmware.types.health import GuardStatus, WatchedService

LOOK_NS: Final = 1_000_000_000
"""Beats are read as often as they come, at the instants of all periodic work of a process."""


class State(StrEnum):
    """How a service stands."""

    WAITING = "waiting"
    STARTING = "starting"
    RUNNING = "running"
    BACK_OFF = "back-off"
    FAILED = "failed"
    STOPPING = "stopping"
    STOPPED = "stopped"


class Event(StrEnum):
    """What can happen to it."""

    SPAWN = "spawn"
    ADOPT = "adopt"
    JOINED = "joined"
    EXIT = "exit"
    GIVE_UP = "give up"
    STOP = "stop"


TRANSITIONS: Final[dict[tuple[State, Event], State]] = {
    (State.WAITING, Event.SPAWN): State.STARTING,
    (State.WAITING, Event.ADOPT): State.RUNNING,
    (State.WAITING, Event.STOP): State.STOPPED,
    (State.STARTING, Event.JOINED): State.RUNNING,
    (State.STARTING, Event.EXIT): State.BACK_OFF,
    (State.STARTING, Event.STOP): State.STOPPING,
    (State.RUNNING, Event.EXIT): State.BACK_OFF,
    (State.RUNNING, Event.STOP): State.STOPPING,
    (State.BACK_OFF, Event.SPAWN): State.STARTING,
    (State.BACK_OFF, Event.ADOPT): State.RUNNING,
    (State.BACK_OFF, Event.GIVE_UP): State.FAILED,
    (State.BACK_OFF, Event.STOP): State.STOPPED,
    (State.FAILED, Event.SPAWN): State.STARTING,
    (State.FAILED, Event.ADOPT): State.RUNNING,
    (State.FAILED, Event.STOP): State.STOPPED,
    (State.STOPPING, Event.EXIT): State.STOPPED,
}


class Spawn(msgspec.Struct, frozen=True):
    """Start the process of a service."""

    service: str


class Kill(msgspec.Struct, frozen=True):
    """End the process of a service at once: it hangs, or did not end when asked."""

    service: str
    pid: int
    reason: str


class Ask(msgspec.Struct, frozen=True):
    """Ask the process of a service to end."""

    service: str
    pid: int


class Tell(msgspec.Struct, frozen=True):
    """Something happened to a service that an operator should know."""

    service: WatchedService


class Follow(msgspec.Struct, frozen=True):
    """Report the end of this process of a service."""

    service: str
    pid: int


class Joined(msgspec.Struct, frozen=True):
    """The service is on the node: the note of its start is not needed any more."""

    service: str


class Look(msgspec.Struct, frozen=True):
    """See who is on the node and who beats, then call `on_looked`: nobody is judged by what was not read."""


Action = Spawn | Kill | Ask | Tell | Follow | Joined | Look


class Watched(msgspec.Struct):
    """One service under the guard."""

    name: str
    state: State = State.WAITING
    pid: int = 0
    restarts: int = 0
    in_a_row: int = 0
    since_ns: int = 0
    adopted: bool = False
    reason: str = ""
    beat: int = -1
    deadline_ns: int | None = None
    """Until then: starting, it joins; running, it beats; backing off, it waits; stopping, it ends."""
    missed: bool = False
    """It ran under the guard before this one."""
    blame: str = ""
    """Why we killed it: the reason that its exit will have."""

    def to(self, event: Event, now_ns: int) -> None:
        """The next state of the table."""
        self.state = TRANSITIONS[self.state, event]
        self.since_ns = now_ns
        self.deadline_ns = None

    def public(self) -> WatchedService:
        """What others see."""
        return WatchedService(
            self.name, self.state.value, self.pid, self.restarts, self.since_ns, self.adopted, self.reason
        )


def died(how: str) -> str:
    """Reason of a restart; of another's child nobody but its parent learns how it ended."""
    return "died" if how == "gone" else f"died: {how}"


class GuardCore:
    """Services in the order of their start; stopped in the reverse order."""

    def __init__(
        self,
        services: tuple[str, ...],
        supervisor: str,
        config: Config,
    ) -> None:
        self._services = {name: Watched(name) for name in services}
        self._supervisor = supervisor
        self._hung_ns = round(config.hung_s * 1e9)
        self._start_ns = round(config.start_s * 1e9)
        self._back_off_ns = [round(pause_s * 1e9) for pause_s in config.back_off_s]
        self._settled_ns = round(config.settled_s * 1e9)
        self._limit = config.restart_limit
        self._stop_ns = round(config.stop_s * 1e9)
        self._stopping: list[str] | None = None
        self._look_ns: int | None = None
        """When beats are read next."""

    def __contains__(self, name: str) -> bool:
        return name in self._services

    def pid(self, name: str) -> int:
        """Its process; 0 when there is none."""
        return self._services[name].pid

    @property
    def stopped(self) -> bool:
        """Whether nothing runs any more, after `stop`."""
        return self._stopping is not None and all(
            watched.state is State.STOPPED for watched in self._services.values()
        )

    def status(self) -> GuardStatus:
        """The state of all services."""
        services = tuple(watched.public() for watched in self._services.values())
        return GuardStatus(self._supervisor, services, sum(watched.restarts for watched in services))

    def remember(self, before: GuardStatus) -> None:
        """Goes on with the counters of a guard that was killed."""
        for old in before.services:
            if (watched := self._services.get(old.name)) is not None:
                watched.restarts = old.restarts
                watched.reason = old.reason
                watched.missed = old.state == State.RUNNING

    # -- what happens

    def on_start(self, running: dict[str, int], born: dict[str, int], now_ns: int) -> list[Action]:
        """Adopts what runs already (pid by name), waits for what was just started, starts the rest."""
        self._look_ns = now_ns
        actions: list[Action] = []
        for watched in self._services.values():
            if watched.name in running:
                actions += self._adopt(watched, running[watched.name], now_ns)
                continue
            spawn = self._spawn(watched, now_ns)
            if watched.name in born:
                watched.pid = born[watched.name]
                watched.adopted = True
                actions.append(Follow(watched.name, watched.pid))
                continue
            if watched.missed:
                watched.restarts += 1
                watched.reason = "died while no guard ran"
                actions.append(Tell(watched.public()))
            actions.append(spawn)
        return actions

    def on_spawned(self, name: str, pid: int, now_ns: int) -> list[Action]:
        """The process was started; 0: by somebody else, who does not say which it is."""
        self._services[name].pid = pid
        return [Follow(name, pid)] if pid else []

    def on_joined(self, name: str, pid: int, now_ns: int) -> list[Action]:
        """The service has an application file, by whomever it was started."""
        watched = self._services[name]
        if watched.state is State.STARTING and watched.pid in {pid, 0}:
            watched.to(Event.JOINED, now_ns)
            followed, watched.pid = watched.pid, pid
            self._expect_beat(watched, now_ns)
            return [Joined(name)] if followed else [Joined(name), Follow(name, pid)]
        if (watched.state, Event.ADOPT) in TRANSITIONS and watched.state is not State.WAITING:
            return self._adopt(watched, pid, now_ns)
        return []

    def on_beat(self, name: str, beat: int, now_ns: int) -> list[Action]:
        """The count on its status board; only a change is a sign of life."""
        watched = self._services[name]
        if watched.state is State.RUNNING and beat != watched.beat and not watched.blame:
            watched.beat = beat
            self._expect_beat(watched, now_ns)
        return []

    def on_restarted(self, name: str, restarts: int, now_ns: int) -> list[Action]:
        """Somebody else, the runner of its process, has restarted the service so often."""
        watched = self._services[name]
        if watched.state is not State.RUNNING or restarts <= watched.restarts:
            return []
        watched.restarts = restarts
        watched.reason, watched.blame = watched.blame or "failed", ""
        watched.since_ns = now_ns
        self._expect_beat(watched, now_ns)
        return [Tell(watched.public())]

    def on_exit(self, name: str, pid: int, how: str, now_ns: int) -> list[Action]:
        """A process ended; `how` is `signal 9`, `exit 1` or `gone`."""
        watched = self._services[name]
        if watched.pid != pid or (watched.state, Event.EXIT) not in TRANSITIONS:
            return []
        settled = watched.state is State.RUNNING and now_ns - watched.since_ns >= self._settled_ns
        watched.to(Event.EXIT, now_ns)
        watched.pid = 0
        if self._stopping is not None:
            if (watched.state, Event.STOP) in TRANSITIONS:
                watched.to(Event.STOP, now_ns)  # it died before it was asked
            return self._stop_next(now_ns)
        watched.reason, watched.blame = watched.blame or died(how), ""
        watched.in_a_row = 1 if settled else watched.in_a_row + 1
        if self._limit and watched.in_a_row > self._limit:
            watched.to(Event.GIVE_UP, now_ns)
            watched.reason += f"; given up after {self._limit} restarts in a row"
            return [Tell(watched.public())]
        pause_ns = self._back_off_ns[min(watched.in_a_row, len(self._back_off_ns)) - 1]
        watched.deadline_ns = now_ns + pause_ns
        watched.restarts += 1
        actions: list[Action] = [Tell(watched.public())]
        return actions + self._due(watched, now_ns)

    def on_order(self, name: str, now_ns: int) -> list[Action]:
        """An operator wants the service restarted, also one that was given up."""
        watched = self._services[name]
        if self._stopping is not None:
            return []
        watched.in_a_row = 0
        if watched.state in {State.RUNNING, State.STARTING}:
            watched.blame = "restarted on request"
            watched.deadline_ns = now_ns + self._stop_ns
            watched.beat = -1
            return [Ask(name, watched.pid)]
        if watched.state in {State.FAILED, State.BACK_OFF}:
            watched.reason = "restarted on request"
            watched.restarts += 1
            return [self._spawn(watched, now_ns)]
        return []

    def on_stop(self, now_ns: int) -> list[Action]:
        """Ends everything, the last started first, each after the one before has ended."""
        if self._stopping is not None:
            return []
        self._stopping = list(reversed(self._services))
        for watched in self._services.values():
            if watched.state in {State.WAITING, State.BACK_OFF, State.FAILED}:
                watched.to(Event.STOP, now_ns)
        return self._stop_next(now_ns)

    def deadline_ns(self) -> int | None:
        """When `on_timer` has something to do."""
        if self.stopped or self._look_ns is None:
            return None
        deadline_ns = self._service_deadline_ns()
        return self._look_ns if deadline_ns is None else min(self._look_ns, deadline_ns)

    def _service_deadline_ns(self) -> int | None:
        return min(
            (watched.deadline_ns for watched in self._services.values() if watched.deadline_ns is not None),
            default=None,
        )

    def on_timer(self, now_ns: int) -> list[Action]:
        """Once a second, and whenever something is due."""
        if self._look_ns is not None and self._look_ns <= now_ns:
            self._look_ns = (now_ns // LOOK_NS + 1) * LOOK_NS
        return [Look()]

    def on_looked(self, now_ns: int) -> list[Action]:
        """What is due: pauses that are over, services that hang or do not end.

        When the guard itself was kept from running, nobody else is blamed for having been silent.
        """
        deadline_ns = self._service_deadline_ns()
        late_ns = now_ns - deadline_ns if deadline_ns is not None else 0
        if late_ns > self._hung_ns // 2:
            for watched in self._services.values():
                if watched.deadline_ns is not None and watched.state is not State.BACK_OFF:
                    watched.deadline_ns += late_ns + self._hung_ns // 2
        actions: list[Action] = []
        for watched in self._services.values():
            actions += self._due(watched, now_ns)
        return actions

    # -- what follows

    def _due(self, watched: Watched, now_ns: int) -> list[Action]:
        if watched.deadline_ns is None or watched.deadline_ns > now_ns:
            return []
        silent_s = (now_ns - watched.deadline_ns + self._hung_ns) / 1e9
        match watched.state:
            case State.BACK_OFF:
                return [self._spawn(watched, now_ns)]
            case State.STARTING:
                reason = f"hung: not on the node {self._start_ns / 1e9:g} s after its start"
            case State.RUNNING:
                reason = f"hung: no beat for {silent_s:.1f} s"
            case _:
                reason = "did not end when asked"
        return self._kill(watched, reason, now_ns)

    def _kill(self, watched: Watched, reason: str, now_ns: int) -> list[Action]:
        watched.blame = watched.blame or reason
        watched.deadline_ns = now_ns + self._start_ns
        return [Kill(watched.name, watched.pid, watched.blame)]

    def _spawn(self, watched: Watched, now_ns: int) -> Spawn:
        watched.to(Event.SPAWN, now_ns)
        watched.adopted = False
        watched.pid = 0
        watched.beat = -1
        watched.deadline_ns = now_ns + self._start_ns
        return Spawn(watched.name)

    def _adopt(self, watched: Watched, pid: int, now_ns: int) -> list[Action]:
        watched.to(Event.ADOPT, now_ns)
        watched.adopted = True
        watched.pid = pid
        self._expect_beat(watched, now_ns)
        return [Joined(watched.name), Follow(watched.name, pid)]

    def _expect_beat(self, watched: Watched, now_ns: int) -> None:
        watched.deadline_ns = now_ns + self._hung_ns

    def _stop_next(self, now_ns: int) -> list[Action]:
        actions: list[Action] = []
        while self._stopping:
            watched = self._services[self._stopping[0]]
            if watched.state is State.STOPPING:
                break
            if watched.state is not State.STOPPED:
                watched.to(Event.STOP, now_ns)
                watched.deadline_ns = now_ns + self._stop_ns
                actions.append(Ask(watched.name, watched.pid))
                break
            self._stopping.pop(0)
        return actions
