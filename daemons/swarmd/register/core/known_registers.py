"""The newest application table of each other computer, with hops and age (S1.53–55)."""

from collections.abc import Mapping
from typing import Final

import msgspec

from swarmd.register.config import Config
from swarmware.model.names import MAIN, natural
from swarmware.runtime.core import AT_ONCE
from swarmware.types.register import ApplicationTable, KnownUnit, PartnerTable, PartnerUnit

READ_S: Final = 10.0
"""Period of reading routes; short beside the minutes after which a platform is removed."""
PUBLISH_S: Final = 0.2
"""Minimum time between two publications, so that the start of a swarm causes a few of them, not hundreds."""

Unit = tuple[str, str]
"""Name of a platform, and of a computer (unit) on it."""


class ReadRoutes(msgspec.Struct, frozen=True):
    """Action: read which platforms are reachable, then call `on_routes_read`."""


class Forgotten(msgspec.Struct, frozen=True):
    """Action: log that a platform was removed, because it was not reachable for too long."""

    platform: str


class PublishPartners(msgspec.Struct, frozen=True):
    """Action: publish the table of other computers."""

    table: PartnerTable


Action = ReadRoutes | Forgotten | PublishPartners


class PublishedTable(msgspec.Struct, frozen=True):
    """The table of another computer, and the instant of its creation in the clock of this node."""

    table: ApplicationTable
    made_ns: int


class ReachedUnit(msgspec.Struct, frozen=True):
    """A reachable computer, and the table that it publishes, if one is known."""

    hops: int
    published: PublishedTable | None = None


class _RemoteTable(msgspec.Struct):
    table: ApplicationTable
    made_ns: int
    reached_ns: int
    """Last instant at which the platform was reachable."""
    hops: int = 1
    reachable: bool = True


class RegisterCore:
    """Keeps the newest table of each computer, which is valid because each table has a single writer."""

    def __init__(self, platform: str, unit: str, config: Config) -> None:
        self._own_unit = (platform, unit)
        self._forget_ns = round(config.forget_s * 1e9)
        self._pause_ns = round(min(READ_S, config.forget_s / 4) * 1e9)
        self._next_read_ns = AT_ONCE
        self._next_publication_ns = AT_ONCE
        self._changed = True
        self._published: PartnerTable | None = None
        self._remote_tables: dict[Unit, _RemoteTable] = {}

    def restore(self, known: PartnerTable, now_ns: int) -> None:
        """Continues with the table that the previous process of this register published."""
        for unit in known.units:
            since_ns = unit.unreachable_since_ns
            self._remote_tables[unit.table.platform, unit.table.unit] = _RemoteTable(
                unit.table,
                min(unit.made_ns, now_ns),
                now_ns if since_ns is None else min(since_ns, now_ns),
                unit.hops,
                since_ns is None,
            )
        # the own table never counts as the table of another computer
        self._remote_tables.pop(self._own_unit, None)

    def on_table(self, published: PublishedTable, now_ns: int) -> list[Action]:
        """Stores the table of another computer, unless a newer table is known."""
        table = published.table
        unit = (table.platform, table.unit)
        held = self._remote_tables.get(unit)
        if unit == self._own_unit or (held is not None and rank(table) < rank(held.table)):
            return []
        if held is None:
            self._remote_tables[unit] = _RemoteTable(table, published.made_ns, now_ns)
            self._next_read_ns = AT_ONCE  # reads the hops of the new computer
        elif rank(table) == rank(held.table):
            # the first table of a master may grow without another number
            held.table = table
            held.made_ns = min(held.made_ns, published.made_ns)
        else:
            self._remote_tables[unit] = _RemoteTable(table, published.made_ns, now_ns, held.hops)
        self._changed = True
        return []

    def on_removal(self, platform: str, now_ns: int) -> tuple[bool, list[Action]]:
        """Removes the tables of a platform that has left the swarm; returns whether there was one."""
        gone = [unit for unit in self._remote_tables if unit[0] == platform]
        for unit in gone:
            del self._remote_tables[unit]
        self._changed = self._changed or bool(gone)
        return bool(gone), []

    def on_routes_read(self, reached: Mapping[Unit, ReachedUnit], now_ns: int) -> list[Action]:
        """Takes the reachable computers, which count as alive although their tables may not change."""
        known = set(self._remote_tables)
        for unit, route in reached.items():
            if route.published is not None and unit not in known:
                # removed, and reachable again with an unchanged table
                self.on_table(route.published, now_ns)
        for unit, held in self._remote_tables.items():
            held.reachable = unit in reached
            if held.reachable:
                # a table that does not change is not sent again, so only the route shows life
                held.reached_ns = now_ns
                held.hops = reached[unit].hops
        gone = [
            unit for unit, held in self._remote_tables.items() if now_ns - held.reached_ns >= self._forget_ns
        ]
        for unit in gone:
            del self._remote_tables[unit]
        self._next_read_ns = self._period_after(now_ns)
        self._changed = True
        return [Forgotten(platform) for platform in sorted({platform for platform, _ in gone})]

    def on_timer(self, now_ns: int) -> list[Action]:
        """Requests the routes when they are due, and publishes a changed table."""
        if now_ns >= self._next_read_ns:
            self._next_read_ns = self._period_after(now_ns)
            return [ReadRoutes()]
        if not self._changed or now_ns < self._next_publication_ns:
            return []
        self._changed = False
        table = self.partners()
        # a change that was undone within the pause
        if table == self._published:
            return []
        self._published = table
        self._next_publication_ns = now_ns + round(PUBLISH_S * 1e9)
        return [PublishPartners(table)]

    def _period_after(self, now_ns: int) -> int:
        # at multiples of the period, so that the timers of a host wake its processor together
        return (now_ns // self._pause_ns + 1) * self._pause_ns

    def deadline_ns(self) -> int | None:
        """Instant of the next reading of routes or of the next publication."""
        return min(self._next_read_ns, self._next_publication_ns) if self._changed else self._next_read_ns

    def units(self, own: ApplicationTable, hops: dict[Unit, int], now_ns: int) -> tuple[KnownUnit, ...]:
        """All known tables, the own table first; a computer without a known route counts as one hop away."""
        known = [KnownUnit(own, 0, 0.0)]
        for unit, held in self._sorted():
            age_s = max(0.0, (now_ns - held.made_ns) / 1e9)
            known.append(KnownUnit(held.table, hops.get(unit, 1), age_s))
        return tuple(known)

    def partners(self) -> PartnerTable:
        """The table of all other known computers, as it is published."""
        return PartnerTable(
            tuple(
                PartnerUnit(held.table, held.hops, held.made_ns, None if held.reachable else held.reached_ns)
                for _, held in self._sorted()
            )
        )

    def _sorted(self) -> list[tuple[Unit, _RemoteTable]]:
        return sorted(
            self._remote_tables.items(), key=lambda item: (natural(item[0][0]), item[0][1] != MAIN, item[0])
        )


def rank(table: ApplicationTable) -> tuple[int, int, int]:
    """Sort key of the tables of one computer: boot, then master, then change; the highest is the newest."""
    return table.boot_id, table.epoch, table.version
