"""Health: checks and their results, faults, and the supervision of processes by the guard."""

from enum import StrEnum
from typing import Annotated, Final, Literal, cast

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.bounds import Seconds
from swarmware.types.registry import register

Confirm = Annotated[int, msgspec.Meta(ge=1, le=10_000)]
"""Number of results that confirm a state."""
Level = Literal["ok", "warn", "error"]
"""Severity of a state: `warn`: an operator should check it, `error`: missions must not rely on it."""

WORSE: dict[str, int] = {"ok": 0, "warn": 1, "error": 2}
"""Order of the levels."""

OK_STATE = "ok"
"""Name of the state that needs no action."""


def default_level(state: str) -> Level:
    """Default level of a state: `ok`, `warn` for `warn`, `error` for any other."""
    return cast(Level, state) if state in WORSE else "error"


class Phase(StrEnum):
    """Life of a fault."""

    PENDING = "pending"
    """Detected, but not confirmed yet."""
    CONFIRMED = "confirmed"
    HEALED = "healed"
    """The check passes; the fault is stored until the clear time is over."""
    CLEARED = "cleared"


@register
class StateRule(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One state that a criterion can return."""

    state: str
    level: Level = "error"
    actions: tuple[str, ...] = ()
    """Names of the actions registered for it, which run in the module that registered them."""


@register
class CheckRegistration(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A check that a module runs itself and reports to the monitor."""

    check: str
    """Identity on this platform: `planner/path_age`."""
    app: str
    """Application that runs it: `planner#1`."""
    frequency_hz: Annotated[float, msgspec.Meta(ge=1e-6, le=1e6)]
    """Rate of its reports; a check without a report for three periods is a fault itself."""
    states: tuple[StateRule, ...] = ()
    confirm_n: Confirm = 1
    """n of the last m results must agree to confirm a state."""
    confirm_m: Confirm = 1
    clear_s: Seconds = 5.0
    """Time after which a healed fault is cleared."""
    grace_s: Seconds = 0.0
    """Grace time after the start, in which nothing is evaluated."""
    description: str = ""
    withdrawn: bool = False
    """The module withdraws its check."""


@register
class CheckReport(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Present result of a module's own check."""

    check: str
    state: str
    """Confirmed state, after the module's own debouncing."""
    stamp_ns: int
    """When the data was sampled."""
    seen: str = ""
    """State of the last sample, while it is not confirmed."""
    freeze: str = ""
    """The evaluated data as text: the freeze frame of a fault."""
    level: Literal["", "ok", "warn", "error"] = ""
    """Level of the state, or "" for the registered level."""


@register
class CheckReports(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All checks of one application (board `health/checks/<application>`), on change and once a second."""

    app: str
    """`planner#1`."""
    reports: tuple[CheckReport, ...] = ()


@register
class Fault(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One fault and its phase."""

    check: str
    state: str
    level: Level
    phase: Phase
    first_ns: int
    """Hardware clock when it was first detected since it was cleared last."""
    last_ns: int
    """Hardware clock when it was last detected."""
    count: int
    """Number of confirmations before the fault was cleared."""
    freeze: str = ""
    """The data at the moment it was confirmed first."""
    message: str = ""

    @property
    def what(self) -> str:
        """Text with the description of the check and the freeze frame."""
        return ": ".join(part for part in (self.message, self.freeze) if part)


@register
class HealthState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Logical system state of a platform (S2.14, S1.27): small enough to be read by the whole swarm."""

    level: Level
    """The worst of all confirmed faults."""
    battery: Literal["unknown", "ok", "low", "critical"] = "unknown"
    battery_ratio: float = -1.0
    """Remaining charge from 0 to 1, or a negative number if unknown."""
    sensors: dict[str, bool] = {}
    """Validity by resource path: present, fresh and confirmed."""
    faults: tuple[str, ...] = ()
    """Confirmed faults as `check=state`, worst first, at most 16."""
    fault_count: int = 0
    checks: int = 0
    """Checks registered, by modules and by the template."""
    apps_alive: int = 0
    apps_failed: int = 0
    """Applications that died without leaving, or hang."""
    guard: Literal["alive", "hung", "absent"] = "absent"


@register
class NotReady(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One item for which a vehicle is not ready to be armed."""

    item: str
    """estimator, fix, battery, link, remote, fence or faults."""
    reason: str
    """Text for operators: `charge 0.12, warned of below 0.3`."""


@register
class Readiness(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Whether a vehicle is ready to be armed (board `health/ready`, on change and once a second)."""

    ready: bool
    not_ready: tuple[NotReady, ...] = ()
    """Items that are not ready, each with its reason; without any, the vehicle may be armed."""
    items: tuple[str, ...] = ()
    """Items that apply to this vehicle."""
    warnings: tuple[NotReady, ...] = ()
    """Items that an operator should act on, each with its reason; they do not refuse."""

    @property
    def reasons(self) -> str:
        """The items that are not ready in one line, or "" if all are ready."""
        return "; ".join(f"{one.item}: {one.reason}" for one in self.not_ready)


@register
class CheckState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One check and its present result."""

    check: str
    app: str
    """Application that runs it; `health` for a rule of the monitor."""
    state: str
    level: Level
    since_ns: int
    frequency_hz: float
    description: str = ""


@register
class HealthReport(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of the monitor: the answer of `sys/health/state`."""

    platform: str
    stamp_ns: int
    state: HealthState
    checks: tuple[CheckState, ...] = ()


@register
class FaultQuery(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request for the list of faults."""

    cleared: bool = False
    """Whether to include cleared faults."""


@register
class FaultClear(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request to clear faults, and to remove checks of applications and platforms that have ended."""

    pattern: str
    """Pattern of names of checks: `age/sensor/**`, `platform/uav3`."""


@register
class FaultList(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Faults of one platform, newest first."""

    platform: str
    stamp_ns: int
    faults: tuple[Fault, ...] = ()


class ServiceState(OpenEnum):
    """State of a supervised service."""

    WAITING = "waiting"
    """Not checked yet."""
    STARTING = "starting"
    RUNNING = "running"
    BACK_OFF = "back-off"
    """The process ended and is started again after a pause."""
    FAILED = "failed"
    """Given up: it ended too often."""
    STOPPING = "stopping"
    STOPPED = "stopped"


class SupervisorKind(OpenEnum):
    """Starter of the processes of services."""

    SELF = "self"
    """The guard."""
    SYSTEMD = "systemd"
    RUNNER = "runner"
    """No supervisor: the services share the process of the guard."""


@register
class WatchedService(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One service under the guard."""

    name: str
    state: ServiceState
    pid: int = 0
    restarts: int = 0
    since_ns: int = 0
    """Hardware clock of the last change."""
    adopted: bool = False
    """Found running, not started by this guard."""
    reason: str = ""
    """Why it was last restarted: `died: signal 9`, `died: exit 1`, `hung: no beat for 3.2 s`."""
    stopped_by: str = ""
    """Requester of the stop, or "" if it was not stopped; it starts again on request, or with the node."""
    nice: int = 0
    """Nice value of the process, set by load: 5 is a lower priority, -5 a higher one."""
    cores: tuple[int, ...] = ()
    """Cores on which the service runs, set by load; () permits all."""


UNSTOPPABLE: Final[dict[str, str]] = {
    "guard": "it starts the others again",
    "broker": "the node is reached through it, also to start it again",
}
"""Services that an operator cannot stop, with the reason."""


@register
class GuardStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Services under the guard, and its actions."""

    supervisor: SupervisorKind
    """Starter of the processes."""
    services: tuple[WatchedService, ...] = ()
    restarts: int = 0

    def why_not_stopped(self, service: str) -> str:
        """Reason for which an operator cannot stop a service, or "" if the operator can."""
        if (why := UNSTOPPABLE.get(service)) is not None:
            return f"service {service!r}: cannot be stopped: {why}"
        if self.supervisor == SupervisorKind.SYSTEMD:
            return (
                f"service {service!r}: its unit is under systemd;"
                f" expected `systemctl stop swarmd@{service}` on its machine"
            )
        return ""


@register
class RestartOrder(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request to restart one service of a node."""

    service: str


@register
class StopOrder(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request to stop one service of a node until it is started again."""

    service: str


@register
class StartOrder(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request to start one service of a node that was stopped."""

    service: str
