"""Drivers of platforms, from the boards of their hardware abstraction."""

import msgspec

from swarmctl.commandline.nodes import names_one
from swarmctl.resources.fanout import read_boards, warn_errors
from swarmctl.session.session import Session
from swarmctl.terminal.table import Cell, Column
from swarmware.errors import Partial
from swarmware.types.driver import DriverStatus, DriverTable


class PlatformDrivers(msgspec.Struct, frozen=True):
    """Drivers of a platform."""

    platform: str
    drivers: list[DriverStatus]
    """Drivers of `hal/drivers`, in the order of its configuration."""


class DriverList(msgspec.Struct, frozen=True):
    """The drivers of platforms."""

    platforms: list[PlatformDrivers]
    silent: list[str]
    """Platforms that did not answer."""


async def list_drivers(session: Session) -> None:
    """Prints the drivers of the selected platforms, else of all.

    Raises: Partial when a platform did not answer; the error itself when one was named.
    """
    asked = await session.selected()
    tables, errors = await read_boards(session, asked, "hal/drivers", DriverTable)
    if session.platform in errors and names_one(session.settings.node):
        raise errors[session.platform]
    if session.settings.structured:
        rows = [
            PlatformDrivers(platform, list(tables[platform].drivers))
            for platform in asked
            if platform in tables
        ]
        session.out.document(DriverList(rows, sorted(errors)))
    else:
        columns = [
            Column("PLATFORM"),
            Column("DRIVER"),
            Column("HALF", wide=True),
            Column("STATE"),
            Column("ASKED Hz", right=True),
            Column("REAL Hz", right=True),
            Column("P99 ms", right=True, drop=2),
            Column("WORST ms", right=True),
            Column("MISSED", right=True, drop=1),
            Column("ERRORS", right=True),
            Column("READS", right=True, wide=True),
            Column("NOTE"),
        ]
        lines = [
            _row(platform, driver)
            for platform in asked
            if platform in tables
            for driver in tables[platform].drivers
        ]
        session.out.table(columns, lines, empty="no platform has drivers")
    warn_errors(session, errors)
    if errors:
        raise Partial(f"hal: {len(errors)} of {len(asked)} platforms did not answer")


def _row(platform: str, driver: DriverStatus) -> tuple[Cell, ...]:
    return (
        platform,
        driver.name,
        "actuator" if driver.actuator else "sensor",
        driver.state,
        f"{driver.asked_hz:g}",
        f"{driver.real_hz:g}",
        f"{driver.p99_late_ms:.1f}",
        f"{driver.worst_late_ms:.1f}",
        driver.missed,
        driver.errors,
        driver.reads,
        driver.note,
    )
