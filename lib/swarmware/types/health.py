"""Health: what is checked, how it stands, which faults there are, and what the guard does about processes."""

from enum import StrEnum
from typing import Annotated, Literal

import msgspec

from swarmware.types.bounds import Seconds
from swarmware.types.registry import register

Confirm = Annotated[int, msgspec.Meta(ge=1, le=10_000)]
"""Results that are counted before a state is believed."""
Level = Literal["ok", "warn", "error"]
"""How bad a state is: `warn` an operator should look, `error` missions must not rely on it."""

WORSE: dict[str, int] = {"ok": 0, "warn": 1, "error": 2}
"""Order of the levels."""

OK_STATE = "ok"
"""Name of the state that needs no action."""


def default_level(state: str) -> Level:
    """How bad a state is that nobody spoke of: `ok` is fine, `warn` a warning, any other an error."""
    return "ok" if state == OK_STATE else "warn" if state == "warn" else "error"


class Phase(StrEnum):
    """Life of a fault."""

    PENDING = "pending"
    """Seen, not yet often enough to be believed."""
    CONFIRMED = "confirmed"
    HEALED = "healed"
    """The cause is gone; kept until it stays away."""
    CLEARED = "cleared"


@register
class StateRule(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One state that a criterion can return."""

    state: str
    level: Level = "error"
    actions: tuple[str, ...] = ()
    """Names of the actions registered for it; for people, they run where they were registered."""


@register
class CheckRegistration(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A check that a module runs itself and reports: S1's triple as the monitor has to know it."""

    check: str
    """Identity on this platform: `planner/path_age`."""
    app: str
    """Application that runs it: `planner#1`."""
    frequency_hz: Annotated[float, msgspec.Meta(ge=1e-6, le=1e6)]
    """How often it reports; a check silent for three periods is itself a fault."""
    states: tuple[StateRule, ...] = ()
    confirm_n: Confirm = 1
    """n of the last m results must agree before a state is believed."""
    confirm_m: Confirm = 1
    clear_s: Seconds = 5.0
    """A healed fault that stays away for so long is cleared."""
    grace_s: Seconds = 0.0
    """After start-up nothing is judged for so long."""
    description: str = ""
    withdrawn: bool = False
    """The module takes its check back."""


@register
class CheckReport(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Present result of a module's own check."""

    check: str
    state: str
    """Believed: the module's own debounce is behind it."""
    stamp_ns: int
    """When the data was looked at."""
    seen: str = ""
    """What the last look gave, when it is not believed yet."""
    freeze: str = ""
    """The data that the criterion saw, as text: the freeze-frame of a fault."""
    level: Literal["", "ok", "warn", "error"] = ""
    """How bad the state is; empty: as the registration says."""


@register
class CheckReports(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All checks of one application (board `health/checks/<application>`), on change and once a second."""

    app: str
    """`planner#1`."""
    reports: tuple[CheckReport, ...] = ()


@register
class Fault(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One fault and how its life stands."""

    check: str
    state: str
    level: Level
    phase: Phase
    first_ns: int
    """Hardware clock when it was first seen, in this life of the fault."""
    last_ns: int
    """Hardware clock when it was last seen."""
    count: int
    """How often it was confirmed before it was cleared."""
    freeze: str = ""
    """The data at the moment it was confirmed first."""
    message: str = ""

    @property
    def what(self) -> str:
        """For people: what the check is about, and what it saw."""
        return ": ".join(part for part in (self.message, self.freeze) if part)


@register
class HealthState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Logical system state of a platform (S2.14, S1.27): small enough to be read by the whole swarm."""

    level: Level
    """The worst of all confirmed faults."""
    battery: Literal["unknown", "ok", "low", "critical"] = "unknown"
    battery_ratio: float = -1.0
    """Remaining charge, 0–1; negative when unknown."""
    sensors: dict[str, bool] = {}
    """Validity by resource path: present, fresh and believed."""
    faults: tuple[str, ...] = ()
    """Confirmed faults as `check=state`, worst first, at most 16."""
    fault_count: int = 0
    checks: int = 0
    """Checks registered, by modules and by the template."""
    apps_alive: int = 0
    apps_failed: int = 0
    """Applications dead without goodbye, or hung."""
    guard: Literal["alive", "hung", "absent"] = "absent"


@register
class CheckState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One check and its present result."""

    check: str
    app: str
    """Who runs it; `health` when it is a rule of the monitor."""
    state: str
    level: Level
    since_ns: int
    frequency_hz: float
    description: str = ""


@register
class HealthReport(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Everything the monitor knows: the answer of `sys/health/state`."""

    platform: str
    stamp_ns: int
    state: HealthState
    checks: tuple[CheckState, ...] = ()


@register
class FaultQuery(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request for the list of faults."""

    cleared: bool = False
    """Also those that are over."""


@register
class FaultClear(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request to end faults that an operator has seen, and to forget what will not come back."""

    pattern: str
    """Of names of checks: `age/sensor/**`, `platform/uav3`."""


@register
class FaultList(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Faults of one platform, newest first."""

    platform: str
    stamp_ns: int
    faults: tuple[Fault, ...] = ()


@register
class WatchedService(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One service under the guard."""

    name: str
    state: str
    """starting | running | back-off | failed | stopping | stopped."""
    pid: int = 0
    restarts: int = 0
    since_ns: int = 0
    """Hardware clock of the last change."""
    adopted: bool = False
    """Found running, not started by this guard."""
    reason: str = ""
    """Why it was last restarted: `died: signal 9`, `died: exit 1`, `hung: no beat for 3.2 s`."""


@register
class GuardStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """What the guard watches and did."""

    supervisor: str
    """self | systemd | runner: who starts processes."""
    services: tuple[WatchedService, ...] = ()
    restarts: int = 0


@register
class RestartOrder(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request to restart one service of a node."""

    service: str
