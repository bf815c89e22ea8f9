"""Applications of a platform, or of all platforms, from a register."""

import msgspec

from swarmctl.commandline.nodes import is_selection
from swarmctl.resources.fanout import ask_all
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Cell, Column
from swarmware.errors import NotFound, Partial
from swarmware.model import names
from swarmware.types.health import GuardStatus
from swarmware.types.register import KnownUnit, Register
from swarmware.types.rpc import Empty


class StoppedService(msgspec.Struct, frozen=True):
    """A service that an operator stopped."""

    platform: str
    service: str
    by: str
    """Who stopped it."""


class ApplicationList(msgspec.Struct, frozen=True):
    """Tables of applications, one per unit."""

    units: list[KnownUnit]
    stopped: list[StoppedService]
    """Services that an operator stopped; the guard does not start them."""


async def list_applications(session: Session) -> None:
    """Prints the applications of a platform, or of several as the joined node knows them.

    Raises: NotFound when the register of a platform is not known here yet.
    """
    several = is_selection(session.settings.node)
    asked = await session.selected() if several else [session.platform]
    register_of = session.here if several else session.platform
    register = await session.ask(names.join(register_of, "sys/register/apps"), Empty(), Register)
    units = [unit for unit in register.units if unit.table.platform in asked]
    there = {unit.table.platform for unit in units}
    if not units:
        raise NotFound(
            f"register of {', '.join(asked)}: not known here; expected a table of its register daemon"
        )
    statuses, _ = await ask_all(session, asked, "sys/guard/status", Empty(), GuardStatus)
    stopped = [
        StoppedService(name, one.name, one.stopped_by)
        for name, status in statuses.items()
        for one in status.services
        if one.stopped_by
    ]
    rows: list[tuple[Cell, ...]] = [
        (
            f"{unit.table.platform}.{unit.table.unit}",
            f"{app.name}#{app.instance}",
            "running",
            app.pid,
            spoken((unit.table.stamp_ns - app.started_ns) / 1e9 + unit.age_s),
            app.provides,
            len(app.serves),
            unit.hops,
            unit.table.master == f"{app.name}#{app.instance}",
        )
        for unit in units
        for app in unit.table.applications
    ]
    rows += [(one.platform, one.service, f"stopped by {one.by}", *[None] * 6) for one in stopped]
    columns = [
        Column("UNIT"),
        Column("APPLICATION"),
        Column("STATE"),
        Column("PID", right=True),
        Column("UP", right=True),
        Column("RESOURCES", right=True),
        Column("COMMANDS", right=True, drop=1),
        Column("HOPS", right=True, drop=2),
        Column("MASTER"),
    ]
    if session.settings.structured:
        session.out.document(ApplicationList(units, stopped))
    else:
        session.out.table(columns, rows, empty="no application is registered")
    for unit in units:
        if unit.table.omitted:
            session.out.warn(
                f"{unit.table.platform}: {unit.table.omitted} more applications than the table has room for"
            )
    if absent := [name for name in asked if name not in there]:
        raise Partial(
            f"register of {', '.join(absent)}: not known here; expected a table of its register daemon"
        )
