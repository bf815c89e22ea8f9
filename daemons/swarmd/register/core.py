"""Registers of other computers: the newest of each, with hops and age (S1.53–55)."""

from collections.abc import Mapping
from typing import Final

import msgspec

from swarmd.register.config import Config
from swarmware.names import natural
from swarmware.runtime.core import AT_ONCE
from swarmware.types.register import ApplicationTable, KnownUnit

LOOK_S: Final = 10.0
"""How often old platforms are looked for; they are forgotten after minutes."""

Unit = tuple[str, str]
"""Platform and unit."""


class Look(msgspec.Struct, frozen=True):
    """See who can be reached, then call `on_looked`."""


class Forgotten(msgspec.Struct, frozen=True):
    """Nothing was heard of this platform for so long that its table is of no use."""

    platform: str


Action = Look | Forgotten


class _Held(msgspec.Struct):
    table: ApplicationTable
    heard_ns: int


class RegisterCore:
    """One table a unit: each has a single writer, so the newest wins and a partition needs no vote."""

    def __init__(self, platform: str, unit: str, config: Config) -> None:
        self._me = (platform, unit)
        self._forget_ns = round(config.forget_s * 1e9)
        self._pause_ns = round(min(LOOK_S, config.forget_s / 4) * 1e9)
        self._look_ns = AT_ONCE
        self._held: dict[Unit, _Held] = {}

    def on_table(self, table: ApplicationTable, now_ns: int) -> list[Action]:
        """A table that came from elsewhere; one of our own, or older than what is known, is not taken."""
        unit = (table.platform, table.unit)
        held = self._held.get(unit)
        if unit != self._me and (held is None or rank(table) >= rank(held.table)):
            self._held[unit] = _Held(table, now_ns)
        return []

    def on_looked(self, reached: Mapping[str, ApplicationTable | None], now_ns: int) -> list[Action]:
        """Platforms with a route, with their newest tables: they live, whether the tables change or not."""
        for (platform, _), held in self._held.items():
            if platform in reached:
                held.heard_ns = now_ns
        known = {platform for platform, _ in self._held}
        for platform, table in reached.items():
            if table is not None and platform not in known:
                self.on_table(table, now_ns)  # it was forgotten, and is back as it was
        gone = [unit for unit, held in self._held.items() if now_ns - held.heard_ns >= self._forget_ns]
        for unit in gone:
            del self._held[unit]
        return [Forgotten(platform) for platform in sorted({platform for platform, _ in gone})]

    def on_timer(self, now_ns: int) -> list[Action]:
        """It is time to look."""
        self._look_ns = (now_ns // self._pause_ns + 1) * self._pause_ns
        return [Look()]

    def deadline_ns(self) -> int | None:
        """When to look next."""
        return self._look_ns

    def units(self, own: ApplicationTable, hops: dict[str, int], now_ns: int) -> tuple[KnownUnit, ...]:
        """All registers known here, our own first; a platform without a known route counts as one hop."""
        known = [KnownUnit(own, 0, 0.0)]
        for (platform, _), held in sorted(self._held.items(), key=lambda item: natural(item[0][0])):
            age_s = max(0.0, (now_ns - held.heard_ns) / 1e9)
            known.append(KnownUnit(held.table, hops.get(platform, 1), age_s))
        return tuple(known)


def rank(table: ApplicationTable) -> tuple[int, int, int]:
    """Order of the tables of one unit: a later boot, a later master, a later change."""
    return table.boot_id, table.epoch, table.version
