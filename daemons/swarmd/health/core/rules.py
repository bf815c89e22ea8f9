"""Rules that the monitor evaluates itself, for ages of resources and limits of values."""

import math
from collections.abc import Callable
from typing import Final

from swarmware.health.debouncer import Debouncer
from swarmware.model.resource import STALE_PERIODS, Resource
from swarmware.types.health import OK_STATE, Level

STALE: Final = "stale"
LOST: Final = "lost"
LOST_PERIODS: Final = 10.0
LOST_MIN_S: Final = 3.0
"""Minimum age of a lost resource; a killed service restarts faster, so its resource is only stale."""
AGE_CONFIRM_SAMPLES: Final = 2
"""Number of samples that must agree; load of the machine may delay a single one."""

AGE_LEVELS: Final[dict[str, Level]] = {OK_STATE: "ok", STALE: "warn", LOST: "error"}


class AgeRule:
    """Age of a resource with a rate: stale after three periods, lost after ten periods and at least 3 s."""

    def __init__(self, resource: Resource, grace_until_ns: int, *, critical: bool = False) -> None:
        self.path = resource.path
        self._critical = critical
        self.check = f"age/{resource.path}"
        self.rate_hz = resource.rate_hz
        self.stale_s = stale_s = resource.stale_after_s
        self._stale_ns = round(stale_s * 1e9)
        self._lost_ns = round(max(stale_s / STALE_PERIODS * LOST_PERIODS, LOST_MIN_S) * 1e9)
        self._debouncer = Debouncer(
            confirm_n=AGE_CONFIRM_SAMPLES, confirm_m=AGE_CONFIRM_SAMPLES, grace_until_ns=grace_until_ns
        )
        self._grace_until_ns = grace_until_ns
        self._position = -1
        self._changed_ns: int | None = None
        self.since_ns = 0

    @staticmethod
    def applies(resource: Resource) -> bool:
        """True if the resource has a maximum age."""
        return math.isfinite(resource.stale_after_s)

    @property
    def state(self) -> str:
        """The state that the debouncer has confirmed."""
        return self._debouncer.confirmed

    @property
    def raw(self) -> str:
        """The state of the last sample."""
        return self._debouncer.raw

    def level(self, state: str) -> Level:
        """Level of a state; only a critical resource causes an error, because errors prevent a take-off."""
        level = AGE_LEVELS[state]
        return "warn" if level == "error" and not self._critical else level

    @property
    def fresh(self) -> bool:
        """True if the resource has a value that is not stale."""
        return self._changed_ns is not None and self.state == OK_STATE

    def in_grace(self, now_ns: int) -> bool:
        """True during the grace time."""
        return now_ns < self._grace_until_ns

    def age_s(self, now_ns: int) -> float:
        """Time since the last sample that found a new value, or infinity without a value."""
        return math.inf if self._changed_ns is None else (now_ns - self._changed_ns) / 1e9

    def extend(self, late_ns: int) -> None:
        """Forgives a delay of the monitor, which also delays a resource whose owner shares the event loop."""
        if self._changed_ns is not None:
            self._changed_ns += late_ns

    def on_sample(self, position: int, now_ns: int) -> bool:
        """Samples the position of the ring; returns True if another state is confirmed."""
        # the position counts the writes, so an unchanged value counts as a new one
        if position != self._position or self._changed_ns is None:
            self._position = position
            self._changed_ns = now_ns
        age_ns = now_ns - self._changed_ns
        state = LOST if age_ns >= self._lost_ns else STALE if age_ns >= self._stale_ns else OK_STATE
        changed = self._debouncer.on_sample(state, now_ns)
        if changed:
            self.since_ns = now_ns
        return changed


class LimitRule:
    """Limits of one field of a resource, with debouncing."""

    def __init__(
        self,
        check: str,
        path: str,
        field: str,
        criterion: Callable[[float], str],
        confirm: tuple[int, int],
        grace_until_ns: int,
    ) -> None:
        self.check = check
        self.path = path
        self.field = field
        self._criterion = criterion
        self._debouncer = Debouncer(confirm_n=confirm[0], confirm_m=confirm[1], grace_until_ns=grace_until_ns)
        self.value: float | None = None
        self.present = OK_STATE
        """State of the last sample, also during the grace time."""
        self.since_ns = 0

    @property
    def state(self) -> str:
        """The state that the debouncer has confirmed."""
        return self._debouncer.confirmed

    @property
    def raw(self) -> str:
        """The state of the last sample, or `ok` during the grace time."""
        return self._debouncer.raw

    def on_value(self, value: float, now_ns: int) -> bool:
        """Samples the newest value; returns True if another state is confirmed."""
        self.value = value
        # kept apart from `raw`: the readiness to arm judges the value also during the grace time
        self.present = self._criterion(value)
        changed = self._debouncer.on_sample(self.present, now_ns)
        if changed:
            self.since_ns = now_ns
        return changed
