"""Which resources are logged how often: the plan, without reading anything."""

import math
from collections.abc import Iterable
from typing import Final

import msgspec

from swarmware.resource import Kind, Resource

VALUED: Final = frozenset({Kind.BOARD, Kind.EVENT, Kind.STREAM, Kind.SETTING, Kind.COMMAND})
"""Kinds whose values stand in rings."""

_EVERY: Final = frozenset({Kind.EVENT, Kind.STREAM, Kind.COMMAND})
"""Kinds of which each value counts."""


class Track(msgspec.Struct, frozen=True):
    """How one resource is logged."""

    path: str
    kind: Kind
    type: str
    module: str
    every: bool
    """Each value, in order; False: the newest, when it is due."""
    period_ns: int
    """Least time between two entries; 0: each change that is seen."""


def track(resource: Resource) -> Track | None:
    """How this resource is logged; None when it is not."""
    rate_hz = resource.log_hz
    if rate_hz == 0 or resource.kind not in VALUED:
        return None
    return Track(
        resource.path,
        resource.kind,
        resource.type,
        resource.owner or "node",
        resource.kind in _EVERY and math.isinf(rate_hz),
        0 if math.isinf(rate_hz) else round(1e9 / rate_hz),
    )


class Plan:
    """The tracks of a node, kept up with its resource table."""

    def __init__(self) -> None:
        self._tracks: dict[str, Track] = {}
        self._due_ns: dict[str, int] = {}

    @property
    def tracks(self) -> list[Track]:
        """All tracks, by path."""
        return [self._tracks[path] for path in sorted(self._tracks)]

    def update(self, resources: Iterable[Resource]) -> tuple[list[Track], list[str]]:
        """Takes the present table: tracks to open (new or changed), paths to close."""
        wanted = {made.path: made for resource in resources if (made := track(resource)) is not None}
        opened = [made for path, made in sorted(wanted.items()) if self._tracks.get(path) != made]
        closed = [path for path in sorted(self._tracks) if wanted.get(path) != self._tracks[path]]
        self._tracks = wanted
        for path in closed:
            self._due_ns.pop(path, None)
        return opened, closed

    def due(self, path: str, now_ns: int) -> bool:
        """Whether the newest value of a decimated track may be taken now; taking it starts the next period.

        The schedule is absolute: a late look does not slow the rate down.
        """
        period_ns = self._tracks[path].period_ns
        if period_ns == 0:
            return True
        due_ns = self._due_ns.get(path, now_ns)
        if now_ns < due_ns:
            return False
        behind = (now_ns - due_ns) // period_ns
        self._due_ns[path] = due_ns + (behind + 1) * period_ns
        return True
