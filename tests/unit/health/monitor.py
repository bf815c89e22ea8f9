"""A core of the health monitor with its inputs."""

from collections.abc import Callable
from typing import Any

from swarmd.health.config import Config
from swarmd.health.core.monitor import (
    Action,
    FaultChanged,
    MonitorCore,
    RunningApp,
)
from swarmware.model.resource import Resource
from swarmware.types.health import Fault, Phase

SECOND = 1_000_000_000


class Monitor:
    """A monitor whose changes of faults are collected for the test."""

    def __init__(self, **changes: Any) -> None:
        numbers: dict[str, Any] = {"grace_s": 10.0, "clear_s": 5.0, "hung_s": 4.0}
        self.core = MonitorCore(Config(**(numbers | changes)))
        self.changed: list[Fault] = []

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.core, name)
        return self._keep(found) if name.startswith("on_") else found

    def _keep(self, event: Callable[..., list[Action]]) -> Callable[..., list[Action]]:
        def call(*facts: Any) -> list[Action]:
            actions = event(*facts)
            self.changed += [action.fault for action in actions if isinstance(action, FaultChanged)]
            return actions

        return call

    def take(self) -> list[Fault]:
        changed, self.changed = self.changed, []
        return changed


def monitor(**changes: Any) -> Monitor:
    return Monitor(**changes)


def present(core: Monitor, *resources: Resource, app: str = "hal", pid: int = 7, at_ns: int = 0) -> None:
    core.on_running(RunningApp(f"{app}#1", app, pid, at_ns, resources), at_ns)


def look(core: Monitor, path: str, position: int, now_ns: int) -> None:
    age = next(age for age in core.ages() if age.path == path)
    core.on_age_sample(age, position, now_ns)


def told(core: Monitor) -> list[tuple[str, str, Phase]]:
    return [(fault.check, fault.state, fault.phase) for fault in core.take()]
