"""Registers of other computers: the newest of each, with hops and age (S1.53–55)."""

from collections.abc import Mapping
from typing import Final

import msgspec

from swarmd.register.config import Config
from swarmware.model.names import natural
from swarmware.runtime.core import AT_ONCE
from swarmware.types.register import ApplicationTable, KnownUnit

READ_S: Final = 10.0
"""Period of reading routes; platforms are removed after minutes."""

Unit = tuple[str, str]
"""Platform and unit."""


class ReadRoutes(msgspec.Struct, frozen=True):
    """Read which platforms are reachable, then call `on_routes_read`."""


class Forgotten(msgspec.Struct, frozen=True):
    """The table of a platform was removed: it was not reachable for too long."""

    platform: str


Action = ReadRoutes | Forgotten


class PublishedTable(msgspec.Struct, frozen=True):
    """The table of another unit and when its master made it, in the clock of this node."""

    table: ApplicationTable
    made_ns: int


class _RemoteTable(msgspec.Struct):
    table: ApplicationTable
    made_ns: int
    reached_ns: int
    """Last time at which its platform was reachable."""


class RegisterCore:
    """Keeps one table for each unit: each has a single writer, so the newest table is valid."""

    def __init__(self, platform: str, unit: str, config: Config) -> None:
        self._own_unit = (platform, unit)
        self._forget_ns = round(config.forget_s * 1e9)
        self._pause_ns = round(min(READ_S, config.forget_s / 4) * 1e9)
        self._next_read_ns = AT_ONCE
        self._remote_tables: dict[Unit, _RemoteTable] = {}

    def on_table(self, published: PublishedTable, now_ns: int) -> list[Action]:
        """Store a table of another unit; an older one, or one of this unit, is ignored."""
        table = published.table
        unit = (table.platform, table.unit)
        held = self._remote_tables.get(unit)
        if unit == self._own_unit or (held is not None and rank(table) < rank(held.table)):
            return []
        repeated = held is not None and rank(table) == rank(held.table)
        made_ns = min(held.made_ns, published.made_ns) if held is not None and repeated else published.made_ns
        self._remote_tables[unit] = _RemoteTable(table, made_ns, now_ns)
        return []

    def on_routes_read(self, reached: Mapping[str, PublishedTable | None], now_ns: int) -> list[Action]:
        """Platforms with a route and their newest tables: alive although their tables do not change."""
        for (platform, _), held in self._remote_tables.items():
            if platform in reached:
                held.reached_ns = now_ns
        known = {platform for platform, _ in self._remote_tables}
        for platform, published in reached.items():
            if published is not None and platform not in known:
                self.on_table(published, now_ns)  # removed, and reachable again with an unchanged table
        gone = [
            unit for unit, held in self._remote_tables.items() if now_ns - held.reached_ns >= self._forget_ns
        ]
        for unit in gone:
            del self._remote_tables[unit]
        return [Forgotten(platform) for platform in sorted({platform for platform, _ in gone})]

    def on_timer(self, now_ns: int) -> list[Action]:
        """Routes are to be read."""
        self._next_read_ns = (now_ns // self._pause_ns + 1) * self._pause_ns
        return [ReadRoutes()]

    def deadline_ns(self) -> int | None:
        """Next reading of routes."""
        return self._next_read_ns

    def units(self, own: ApplicationTable, hops: dict[str, int], now_ns: int) -> tuple[KnownUnit, ...]:
        """All known registers, the own one first; a platform without a route counts as one hop."""
        known = [KnownUnit(own, 0, 0.0)]
        for (platform, _), held in sorted(self._remote_tables.items(), key=lambda item: natural(item[0][0])):
            age_s = max(0.0, (now_ns - held.made_ns) / 1e9)
            known.append(KnownUnit(held.table, hops.get(platform, 1), age_s))
        return tuple(known)


def rank(table: ApplicationTable) -> tuple[int, int, int]:
    """Order of the tables of one unit: a later boot, a later master, a later change."""
    return table.boot_id, table.epoch, table.version
