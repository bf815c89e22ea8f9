"""Schedule of the requests for conversion functions, and the choice of the platforms to request from."""

from typing import Final

import msgspec

from swarmd.timesync.config import Config
from swarmd.timesync.core.time_core import TimeCore
from swarmware.model.names import Address
from swarmware.runtime.core import AT_ONCE
from swarmware.types.net import Routes

ASK_NS: Final = 10_000_000_000
"""Period of the requests to a neighbour; in 10 s the random walk of a quartz stays below 0.1 µs."""
ASK_FIRST_NS: Final = 2_000_000_000
"""Period of the requests while a function is missing or new; also the wait for a direct exchange."""
YOUNG_SAMPLES: Final = 30
"""Number of exchanges below which a function still improves much."""
MEASURED_DIRECTLY_NS: Final = 10_000_000_000
"""Silence after which the ageing function of a platform is replaced by a function over its neighbours."""


class ReadRouteTable(msgspec.Struct, frozen=True):
    """Action: read the table of routes, then call `on_routes_read`."""


class RequestFunctions(msgspec.Struct, frozen=True):
    """Action: request the functions of a platform, then call `on_request_ended`."""

    platform: str


Action = ReadRouteTable | RequestFunctions


class ExchangeCore:
    """Rounds of requests to neighbours without a measured function, and to neighbours on routes to others."""

    def __init__(self, time: TimeCore, config: Config, now_ns: int) -> None:
        self._time = time
        self._config = config
        self._next_ns = now_ns + ASK_FIRST_NS
        """Instant of the next round."""
        self._missing_ns = AT_ONCE
        """Earliest instant of the next round while a neighbour has no function."""
        self._is_round = False
        self._missing: set[str] = set()
        """Neighbours without a function when the round began."""
        self._far: dict[str, str] = {}
        """Platforms out of direct range, each with the measured neighbour on the route to it."""
        self._open: set[str] = set()
        """Platforms whose answer is pending."""

    def deadline_ns(self) -> int | None:
        """Instant of the next round, or None during a round."""
        if self._is_round:
            return None
        return min(self._next_ns, self._missing_ns) if self._time.unmeasured() else self._next_ns

    def on_timer(self, now_ns: int) -> list[Action]:
        """Begins a round of requests."""
        self._is_round = True
        return [ReadRouteTable()]

    def on_routes_read(self, table: Routes | None, now_ns: int) -> list[Action]:
        """Requests the functions that are missing or must be renewed; `table` is None before routes exist."""
        self._missing = self._time.unmeasured()
        self._far = self._far_platforms(table, now_ns) if self._config.compose else {}
        self._open = self._missing | self._time.stated() | set(self._far.values())
        actions: list[Action] = [RequestFunctions(platform) for platform in sorted(self._open)]
        # without a request nothing would end the round
        if not actions:
            self._end_round(now_ns)
        return actions

    def on_request_ended(self, platform: str, now_ns: int) -> list[Action]:
        """Takes the end of a request, answered or failed; the last one ends the round."""
        self._open.discard(platform)
        if self._is_round and not self._open:
            self._end_round(now_ns)
        return []

    def _end_round(self, now_ns: int) -> None:
        self._is_round = False
        found = []
        if self._far:
            functions = self._time.functions(now_ns)
            found = [functions.of(*Address.parse(name)) for name in self._far]
        is_young = any(one is None or one.samples < YOUNG_SAMPLES for one in found)
        is_soon = is_young or not self._far or bool(self._missing)
        self._next_ns = now_ns + (ASK_FIRST_NS if is_soon else ASK_NS)
        # a neighbour that has no function itself yet is not asked again at once
        self._missing_ns = now_ns + ASK_FIRST_NS if self._missing & self._time.unmeasured() else AT_ONCE

    def _far_platforms(self, table: Routes | None, now_ns: int) -> dict[str, str]:
        measured = self._time.measured_since(now_ns - MEASURED_DIRECTLY_NS)
        return {
            route.name: route.via
            # the neighbour must be measured itself: its function is the first link of the composed one
            for route in (table.routes if table is not None else ())
            if route.hops > 1 and route.name not in measured and route.via in measured
        }
