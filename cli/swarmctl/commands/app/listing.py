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


class ServicePriority(msgspec.Struct, frozen=True):
    """Priority of the process of a service, set by load."""

    platform: str
    service: str
    nice: int
    """Nice value, positive for a lower priority."""
    cores: tuple[int, ...]
    """Cores on which the application runs, or () for all."""


class ApplicationList(msgspec.Struct, frozen=True):
    """Tables of applications, one per unit."""

    units: list[KnownUnit]
    stopped: list[StoppedService]
    """Services that an operator stopped; the guard does not start them."""
    priorities: list[ServicePriority]
    """Services whose processes have another priority than usual, set by the guard by their load."""


async def list_applications(session: Session) -> None:
    """Prints the applications of a platform, or of several as the joined node knows them.

    Raises: NotFound when the register of a platform is not known here yet.
    """
    several = is_selection(session.settings.node)
    asked = await session.selected() if several else [session.platform]
    # one register has all platforms, so for several of them the joined node's is enough
    register = await _register(session, session.here if several else session.platform)
    units = [unit for unit in register.units if unit.table.platform in asked]
    there = {unit.table.platform for unit in units}
    if not units:
        raise NotFound(
            f"register of {', '.join(asked)}: not known here; expected a table of its register daemon"
        )
    # errors are left out: a node without a guard still has applications
    statuses, _ = await ask_all(session, asked, "sys/guard/status", Empty(), GuardStatus)
    stopped = [
        StoppedService(name, one.name, one.stopped_by)
        for name, status in statuses.items()
        for one in status.services
        if one.stopped_by
    ]
    priorities = [
        ServicePriority(name, one.name, one.nice, one.cores)
        for name, status in statuses.items()
        for one in status.services
        if one.nice or one.cores
    ]
    shown = {(one.platform, one.service): _priority(one) for one in priorities}
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
            unit.table.master in {f"{app.name}#{app.instance}", f"pid {app.pid}"},
            shown.get((unit.table.platform, app.name)) if unit.table.unit == names.MAIN else None,
        )
        for unit in units
        for app in unit.table.applications
    ]
    rows += [(one.platform, one.service, f"stopped by {one.by}", *[None] * 7) for one in stopped]
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
    if shown:
        columns.append(Column("PRIORITY"))
    else:
        rows = [row[:-1] for row in rows]
    if session.settings.structured:
        session.out.document(ApplicationList(units, stopped, priorities))
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


async def _register(session: Session, platform: str) -> Register:
    """The register of a platform; while its service does not run, what the joined node knows: the table of
    the application that is master there."""
    try:
        return await session.ask(names.join(platform, "sys/register/apps"), Empty(), Register)
    except NotFound:
        if platform == session.here:
            raise NotFound(
                f"{platform}: its service register does not run; expected `swarmctl app start register`"
            ) from None
        known = await _register(session, session.here)
        if all(unit.table.platform != platform for unit in known.units):
            raise
        session.out.warn(f"{platform}: its service register does not run; shown as {session.here} knows it")
        return known


def _priority(one: ServicePriority) -> str:
    """Niceness and cores: `5 @1,2`."""
    cores = f" @{','.join(map(str, one.cores))}" if one.cores else ""
    return f"{one.nice}{cores}"
