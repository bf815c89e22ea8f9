"""The sampling plan: which resources are logged, and at which rate."""

import math
from collections.abc import Iterable
from typing import Final

import msgspec

from swarmware.model.resource import Kind, Resource

LOGGED_KINDS: Final = frozenset({Kind.BOARD, Kind.EVENT, Kind.STREAM, Kind.SETTING, Kind.COMMAND})
"""Kinds of resource that have a ring in shared memory."""

_EVERY_VALUE_KINDS: Final = frozenset({Kind.EVENT, Kind.STREAM, Kind.COMMAND})
"""Kinds of resource whose values are all logged, not only the newest value of a period."""


class LoggedResource(msgspec.Struct, frozen=True):
    """A logged resource, and the way in which its values are sampled."""

    path: str
    kind: Kind
    type: str
    module: str
    every_value: bool
    """True to log every value in order, False to log the newest value once per period."""
    period_ns: int
    """Minimum time between two entries, or 0 to log every new value."""


def logged_resource(resource: Resource) -> LoggedResource | None:
    """Logging parameters of a resource, or None if it is not logged."""
    rate_hz = resource.log_hz
    if rate_hz == 0 or resource.kind not in LOGGED_KINDS:
        return None
    return LoggedResource(
        resource.path,
        resource.kind,
        resource.type,
        resource.owner or "node",
        resource.kind in _EVERY_VALUE_KINDS and math.isinf(rate_hz),
        0 if math.isinf(rate_hz) else round(1e9 / rate_hz),
    )


class SamplingPlan:
    """The logged resources of a node, updated from its resource table."""

    def __init__(self) -> None:
        self._resources: dict[str, LoggedResource] = {}
        self._due_ns: dict[str, int] = {}

    def update(self, resources: Iterable[Resource]) -> tuple[list[LoggedResource], list[str]]:
        """Applies the resource table; returns new or changed resources to open, and paths to close."""
        wanted = {
            made.path: made for resource in resources if (made := logged_resource(resource)) is not None
        }
        opened = [made for path, made in sorted(wanted.items()) if self._resources.get(path) != made]
        closed = [path for path in sorted(self._resources) if wanted.get(path) != self._resources[path]]
        self._resources = wanted
        for path in closed:
            self._due_ns.pop(path, None)
        return opened, closed

    def waits(self, path: str, now_ns: int) -> bool:
        """True if a decimated resource was already sampled in its present period."""
        return self._due_ns.get(path, now_ns) > now_ns

    def due(self, path: str, now_ns: int) -> bool:
        """True if a decimated resource is due for sampling, which also starts its next period.

        The schedule is absolute, so that a late sample does not lower the mean rate.
        """
        period_ns = self._resources[path].period_ns
        if period_ns == 0:
            return True
        due_ns = self._due_ns.get(path, now_ns)
        if now_ns < due_ns:
            return False
        # periods without a sample are skipped, not caught up in a burst
        behind = (now_ns - due_ns) // period_ns
        self._due_ns[path] = due_ns + (behind + 1) * period_ns
        return True
