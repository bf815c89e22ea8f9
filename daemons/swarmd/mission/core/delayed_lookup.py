"""Present values for the requirements of a mission, on a node whose event loop is late."""

from swarmware.mission.condition import Lookup
from swarmware.mission.field_path import Scalar


class DelayedLookup:
    """Values with their ages, less the time for which this node did not listen.

    The owner of a value has not run meanwhile either, or its value waits to be taken.
    """

    def __init__(self, lookup: Lookup, delay_ns: int) -> None:
        self._lookup = lookup
        self._delay_s = delay_ns / 1e9

    def value(self, path: str, field: str) -> Scalar | None:
        """Newest value of the resource's field (empty: its only field)."""
        return self._lookup.value(path, field)

    def age_s(self, path: str) -> float | None:
        """Age of the newest value."""
        age_s = self._lookup.age_s(path)
        return None if age_s is None else max(age_s - self._delay_s, 0.0)
