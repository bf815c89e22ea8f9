"""Partners of a module: the units of other platforms and the applications that run there."""

from collections.abc import Iterator

import msgspec

from swarmware.errors import NotFound
from swarmware.model.clock import Clock
from swarmware.module.board import BoardReader
from swarmware.types.register import Application, PartnerTable, PartnerUnit


class Partner(msgspec.Struct, frozen=True):
    """One computer of another platform, or another computer of this platform."""

    platform: str
    unit: str
    hops: int
    """Number of hops: 1 for a neighbour, more for other units."""
    age_s: float
    """Age of its table of applications, which its master makes when they change."""
    unreachable_s: float | None
    """Time for which it is not reachable, or None while it is."""
    applications: tuple[Application, ...]
    omitted: int
    """Applications for which its table had no room."""

    def runs(self, name: str) -> bool:
        """Whether an application of this name runs there."""
        return any(application.name == name for application in self.applications)


class Partners:
    """The partners known at present: iterate over them, or wait for a change."""

    def __init__(self, board: BoardReader[PartnerTable], clock: Clock) -> None:
        self._board = board
        self._clock = clock

    def __iter__(self) -> Iterator[Partner]:
        return iter(self._partners(self._board.value))

    def __len__(self) -> int:
        value = self._board.value
        return 0 if value is None else len(value.units)

    def of(self, platform: str) -> tuple[Partner, ...]:
        """The units of a platform.

        Raises: NotFound when it is not known.
        """
        if found := tuple(partner for partner in self if partner.platform == platform):
            return found
        known = ", ".join(dict.fromkeys(partner.platform for partner in self)) or "none"
        raise NotFound(f"partner {platform}: not known; expected one of: {known}")

    async def changed(self, timeout_s: float | None = None) -> tuple[Partner, ...]:
        """Wait for a table that was not read yet; returns all partners.

        Raises: NoAnswer when none arrives within the time-out.
        """
        return self._partners(await self._board.changed(timeout_s))

    def _partners(self, table: PartnerTable | None) -> tuple[Partner, ...]:
        now_ns = self._clock.now_ns()
        return () if table is None else tuple(_partner(unit, now_ns) for unit in table.units)


def _partner(unit: PartnerUnit, now_ns: int) -> Partner:
    table, since_ns = unit.table, unit.unreachable_since_ns
    return Partner(
        table.platform,
        table.unit,
        unit.hops,
        max(0.0, (now_ns - unit.made_ns) / 1e9),
        None if since_ns is None else max(0.0, (now_ns - since_ns) / 1e9),
        table.applications,
        table.omitted,
    )
