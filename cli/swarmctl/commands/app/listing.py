"""Applications of a platform, or of all platforms, from a register."""

import msgspec

from swarmctl.session.session import Session
from swarmctl.terminal.output import Column
from swarmctl.terminal.quantities import spoken
from swarmware.errors import NotFound
from swarmware.types.register import KnownUnit, Register
from swarmware.types.rpc import Empty


class ApplicationList(msgspec.Struct, frozen=True):
    """Tables of applications, one per unit."""

    units: list[KnownUnit]


async def list_applications(session: Session, everywhere: bool) -> None:
    """Prints the applications of the platform of the session; with `everywhere` of all platforms.

    Raises: NotFound when the register of the platform is not known here yet.
    """
    register = await session.ask("sys/register/apps", Empty(), Register)
    units = [u for u in register.units if everywhere or u.table.platform == session.platform]
    if not units:
        raise NotFound(
            f"register of {session.platform}: not known here; expected a table of its register daemon"
        )
    if session.settings.structured:
        session.out.document(ApplicationList(units))
        return
    rows = [
        (
            f"{unit.table.platform}.{unit.table.unit}",
            f"{app.name}#{app.instance}",
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
    columns = [
        Column("UNIT"),
        Column("APPLICATION"),
        Column("PID", right=True),
        Column("UP", right=True),
        Column("RESOURCES", right=True),
        Column("COMMANDS", right=True),
        Column("HOPS", right=True),
        Column("MASTER"),
    ]
    session.out.table(columns, rows)
    for unit in units:
        if unit.table.omitted:
            session.out.warn(
                f"{unit.table.platform}: {unit.table.omitted} more applications than the table has room for"
            )
