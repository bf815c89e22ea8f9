"""Requirements of a mission: conditions that are checked before the start and while it is played (S2.35)."""

from typing import Final

from swarmware.mission.condition import ConditionExpression, Lookup
from swarmware.mission.field_path import Scalar
from swarmware.runtime.loop_delay import LoopDelay

CHECK_NS: Final = 1_000_000_000
"""Period of evaluating the requirements."""
TURNS: Final = 2
"""Turns of a late event loop from a measurement to the value that is computed from it."""
REQUIREMENT_MISSES: Final = 3
"""Consecutive checks in which a requirement cannot be evaluated before it counts as unmet."""


class DelayedLookup:
    """Values with their ages, less the time for which this node did not listen.

    The owner of a value has not run meanwhile either, or its value waits to be taken.
    """

    def __init__(self, lookup: Lookup, delay_ns: int) -> None:
        self._lookup = lookup
        self._delay_s = delay_ns / 1e9

    def value(self, path: str, field: str) -> Scalar | None:
        """Newest value of a resource's field, or of its only field for ""."""
        return self._lookup.value(path, field)

    def age_s(self, path: str) -> float | None:
        """Age of the newest value."""
        age_s = self._lookup.age_s(path)
        return None if age_s is None else max(age_s - self._delay_s, 0.0)


class RequirementWatch:
    """Evaluates the requirements of one run once a second while its mission is played."""

    def __init__(self, conditions: tuple[ConditionExpression, ...], lookup: Lookup, delay: LoopDelay) -> None:
        self._conditions = conditions
        self._lookup = lookup
        self._delay = delay
        self._misses: dict[str, int] = {}
        self.due_ns: int | None = None
        """When `check` must be called, or None while the mission is not played."""
        self.unmet: tuple[str, ...] = ()
        """Requirements that did not hold at the last evaluation."""

    def missing(self) -> str:
        """The first requirement that does not hold now, or "" if all do."""
        return next((one.text for one in self._conditions if one.holds(self._lookup) is not True), "")

    def begin(self, now_ns: int, *, at_once: bool = False) -> None:
        """The mission is played from now on."""
        self.due_ns = now_ns if at_once else now_ns + CHECK_NS

    def check(self, now_ns: int) -> str:
        """Evaluates the requirements if due; returns the first that no longer holds, or "" if all do."""
        if self.due_ns is None or self.due_ns > now_ns:
            return ""
        # a late call skips the missed evaluations: they would all see the same values
        self.due_ns += CHECK_NS * max(1, (now_ns - self.due_ns) // CHECK_NS)
        unmet: list[str] = []
        lookup = DelayedLookup(self._lookup, TURNS * self._delay.recent_ns(now_ns))
        for condition in self._conditions:
            holds = condition.holds(lookup)
            misses = 0 if holds else self._misses.get(condition.text, 0) + 1
            self._misses[condition.text] = misses
            if holds is False or misses >= REQUIREMENT_MISSES:
                unmet.append(condition.text)
        self.unmet = tuple(unmet)
        return unmet[0] if unmet else ""
