"""When a mission state is written to its board: at once on change, repeated, then as a heartbeat."""

from typing import Final

import msgspec

from swarmware.runtime.core import next_multiple_ns
from swarmware.types.mission import MissionState

INTERVAL_NS: Final = 100_000_000
"""Minimum time between two writes: the period of the beacon."""
REPEATS: Final = 3
"""Writes of a change: a datagram in ten may be lost, all three in a thousand."""
HEARTBEAT_NS: Final = 1_000_000_000
"""Period of writes without a change; a member that misses several is lost."""
_QUIET: Final = {"progress_ratio": 0.0, "text": ""}
"""Fields whose change can wait for the heartbeat."""


class Announcer:
    """Decides when the state is written; the caller keeps the state."""

    def __init__(self) -> None:
        self._announced: MissionState | None = None
        self._left = 0
        self._last_ns: int | None = None

    def due(self, state: MissionState, now_ns: int) -> bool:
        """Whether this state is to be written now."""
        key = msgspec.structs.replace(state, **_QUIET)
        if key != self._announced:
            self._announced, self._left = key, REPEATS
        at_ns = self.deadline_ns()
        if at_ns is not None and at_ns > now_ns:
            return False
        self._left = max(0, self._left - 1)
        self._last_ns = now_ns
        return True

    def has_repeated(self, state: MissionState) -> bool:
        """Whether this state was written as often as a change is."""
        return self._left == 0 and msgspec.structs.replace(state, **_QUIET) == self._announced

    def deadline_ns(self) -> int | None:
        """When `due` must be called next without a change, or None if it is due at once."""
        if self._last_ns is None:
            return None
        if self._left:
            return self._last_ns + INTERVAL_NS
        # together with other periodic work of the node, which saves wake-ups, but away from the full second:
        # most of the work is due then
        return next_multiple_ns(self._last_ns, HEARTBEAT_NS, HEARTBEAT_NS // 10 * 7)
