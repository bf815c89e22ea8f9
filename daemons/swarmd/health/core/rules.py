"""Rules of the monitor itself, which need no code in any module: ages of resources, limits of values."""

import math
from collections.abc import Callable
from typing import Final

from swarmware.health.judge import Judge
from swarmware.resource import STALE_PERIODS, Resource
from swarmware.types.health import OK_STATE, Level

STALE: Final = "stale"
LOST: Final = "lost"
LOST_PERIODS: Final = 10.0
LOST_LEAST_S: Final = 3.0
"""A killed service is back in less; what comes back so soon was late, not lost."""
AGE_CONFIRM: Final = 2
"""Looks that must agree: the first may fall on a busy moment of the machine."""

AGE_LEVELS: Final[dict[str, Level]] = {OK_STATE: "ok", STALE: "warn", LOST: "error"}


class AgeRule:
    """A resource with a rate is stale after three periods, lost after ten and at least three seconds."""

    def __init__(self, resource: Resource, grace_until_ns: int, *, critical: bool = False) -> None:
        self.path = resource.path
        self._critical = critical
        self.check = f"age/{resource.path}"
        self.rate_hz = resource.rate_hz
        stale_s = resource.stale_after_s
        self._stale_ns = round(stale_s * 1e9)
        self._lost_ns = round(max(stale_s / STALE_PERIODS * LOST_PERIODS, LOST_LEAST_S) * 1e9)
        self._judge = Judge(confirm_n=AGE_CONFIRM, confirm_m=AGE_CONFIRM, grace_until_ns=grace_until_ns)
        self._grace_until_ns = grace_until_ns
        self._position = -1
        self._changed_ns: int | None = None
        self.since_ns = 0

    @staticmethod
    def applies(resource: Resource) -> bool:
        """Whether there is an age to be judged."""
        return math.isfinite(resource.stale_after_s)

    @property
    def state(self) -> str:
        """The believed state."""
        return self._judge.state

    @property
    def seen(self) -> str:
        """The state of the last look."""
        return self._judge.seen

    def level(self, state: str) -> Level:
        """How bad a state is: only what is declared critical may ground a vehicle."""
        level = AGE_LEVELS[state]
        return "warn" if level == "error" and not self._critical else level

    @property
    def fresh(self) -> bool:
        """Whether it has a value that is not old."""
        return self._changed_ns is not None and self.state == OK_STATE

    def in_grace(self, now_ns: int) -> bool:
        """Whether it is too early to say anything."""
        return now_ns < self._grace_until_ns

    def age_s(self, now_ns: int) -> float:
        """Since its last change that a look has found."""
        return math.inf if self._changed_ns is None else (now_ns - self._changed_ns) / 1e9

    def on_look(self, position: int, now_ns: int) -> bool:
        """The position of the ring at this moment; True when another state is believed."""
        if position != self._position or self._changed_ns is None:
            self._position = position
            self._changed_ns = now_ns
        age_ns = now_ns - self._changed_ns
        state = LOST if age_ns >= self._lost_ns else STALE if age_ns >= self._stale_ns else OK_STATE
        changed = self._judge.on_result(state, now_ns)
        if changed:
            self.since_ns = now_ns
        return changed


class LimitRule:
    """A field of a resource within its limits."""

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
        self._judge = Judge(confirm_n=confirm[0], confirm_m=confirm[1], grace_until_ns=grace_until_ns)
        self.value: float | None = None
        self.since_ns = 0

    @property
    def state(self) -> str:
        """The believed state."""
        return self._judge.state

    @property
    def seen(self) -> str:
        """The state of the last look."""
        return self._judge.seen

    def on_value(self, value: float, now_ns: int) -> bool:
        """The newest value; True when another state is believed."""
        self.value = value
        changed = self._judge.on_result(self._criterion(value), now_ns)
        if changed:
            self.since_ns = now_ns
        return changed
