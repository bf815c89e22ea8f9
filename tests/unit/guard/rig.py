"""A core of the guard and the services that it supervises."""

from typing import Any

from swarmd.guard.config import Config
from swarmd.guard.core.supervision import (
    Action,
    GuardCore,
    ReadHeartbeats,
    ReportRestart,
    Spawn,
)
from swarmware.types.health import SupervisorKind, WatchedService

SECOND = 1_000_000_000


def guard(*services: str, **changes: Any) -> GuardCore:
    numbers: dict[str, Any] = {
        "hung_s": 5.0,
        "start_s": 20.0,
        "back_off_s": (0.0, 0.5, 2.0),
        "settled_s": 10.0,
        "restart_limit": 4,
        "stop_s": 3.0,
    }
    return GuardCore(services or ("tree", "health"), SupervisorKind.SELF, Config(**(numbers | changes)))


def running(core: GuardCore, now_ns: int = 0) -> None:
    """Starts all services, with the pids 10, 20, … in the order of the start."""
    for number, action in enumerate(core.on_start({}, {}, now_ns), 1):
        assert isinstance(action, Spawn)
        core.on_spawned(action.service, 10 * number, now_ns)
        core.on_joined(action.service, 10 * number, now_ns)


def service(core: GuardCore, name: str) -> WatchedService:
    return next(one for one in core.status().services if one.name == name)


def without_tell(actions: list[Action]) -> list[Action]:
    return [action for action in actions if not isinstance(action, ReportRestart)]


def spawned(actions: list[Action]) -> list[str]:
    return [action.service for action in actions if isinstance(action, Spawn)]


def until_something(core: GuardCore) -> tuple[int, list[Action]]:
    """Calls the core at its deadlines until it returns actions; returns the instant and the actions."""
    while (deadline_ns := core.deadline_ns()) is not None:
        assert core.on_timer(deadline_ns) == [ReadHeartbeats()]
        if actions := without_tell(core.on_heartbeats_read(deadline_ns)):
            return deadline_ns, actions
    raise AssertionError("nothing will ever be done")
