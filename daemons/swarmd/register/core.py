"""Registers of other computers: the newest of each, with hops and age (S1.53–55)."""

import msgspec

from swarmware.names import natural
from swarmware.types.register import ApplicationTable, KnownUnit

Unit = tuple[str, str]
"""Platform and unit."""


class _Held(msgspec.Struct):
    table: ApplicationTable
    heard_ns: int


class RegisterCore:
    """One table a unit: each has a single writer, so the newest wins and a partition needs no vote."""

    def __init__(self, platform: str, unit: str, *, forget_s: float) -> None:
        self._me = (platform, unit)
        self._forget_ns = round(forget_s * 1e9)
        self._held: dict[Unit, _Held] = {}

    def on_table(self, table: ApplicationTable, now_ns: int) -> bool:
        """A table that came from elsewhere; False when it is ours, or older than what is known."""
        unit = (table.platform, table.unit)
        if unit == self._me:
            return False
        held = self._held.get(unit)
        if held is not None and rank(table) < rank(held.table):
            return False
        self._held[unit] = _Held(table, now_ns)
        return True

    def on_heard(self, platform: str, now_ns: int) -> bool:
        """The platform lives, though its table has not changed; False when no table of it is known."""
        known = [held for (name, _), held in self._held.items() if name == platform]
        for held in known:
            held.heard_ns = now_ns
        return bool(known)

    def on_timer(self, now_ns: int) -> list[str]:
        """Platforms that are forgotten now."""
        gone = [unit for unit, held in self._held.items() if now_ns - held.heard_ns >= self._forget_ns]
        for unit in gone:
            del self._held[unit]
        return sorted({platform for platform, _ in gone})

    def deadline_ns(self) -> int | None:
        """When the next one is forgotten."""
        return min((held.heard_ns + self._forget_ns for held in self._held.values()), default=None)

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
