"""`swarmctl health`: state and faults of the nodes."""

from typing import TYPE_CHECKING

import click

from swarmctl import completion
from swarmctl.lazy import Group
from swarmctl.settings import settings

if TYPE_CHECKING:
    from swarmctl.output import Cell
    from swarmware.types.health import HealthState


@click.group(cls=Group)
def cmd() -> None:
    """State and faults of the nodes.

    Example: swarmctl health ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """Show the state of every platform, or of one: level, battery, applications, guard, confirmed faults.

    Example: swarmctl health ls
    """
    from swarmctl.fanout import platforms, read_boards, warn_errors
    from swarmctl.output import Column
    from swarmctl.session import Session, run
    from swarmware.errors import Partial
    from swarmware.types.health import HealthState

    async def work(session: Session) -> None:
        asked = [session.platform] if session.settings.node else await platforms(session)
        states, errors = await read_boards(session, asked, "health/state", HealthState)
        if session.settings.node and errors:
            raise errors[session.platform]
        if session.settings.json:
            rows = [{"platform": platform, "state": states.get(platform)} for platform in asked]
            session.out.document({"platforms": rows, "silent": sorted(errors)})
        else:
            columns = [
                Column("PLATFORM"),
                Column("LEVEL"),
                Column("BATTERY", right=True),
                Column("APPS", right=True),
                Column("FAILED", right=True),
                Column("GUARD"),
                Column("CHECKS", right=True),
                Column("FAULTS"),
            ]
            session.out.table(columns, [_row(platform, states.get(platform)) for platform in asked])
        warn_errors(session, errors)
        if errors:
            raise Partial(f"health: {len(errors)} of {len(asked)} platforms did not answer")

    run(settings(ctx), work)


def _row(platform: str, state: "HealthState | None") -> "tuple[Cell, ...]":
    if state is None:
        return (platform, "silent", *[None] * 6)
    battery = f"{state.battery_ratio * 100:.0f} % {state.battery}" if state.battery_ratio >= 0 else None
    more = state.fault_count - len(state.faults)
    faults = ", ".join(state.faults) + (f" and {more} more" if more > 0 else "")
    return (
        platform,
        state.level,
        battery,
        state.apps_alive,
        state.apps_failed,
        state.guard,
        state.checks,
        faults or "none",
    )


@cmd.command()
@click.argument("platform", required=False, shell_complete=completion.platforms)
@click.pass_context
def info(ctx: click.Context, platform: str | None) -> None:
    """Show each check of a platform and its present result.

    Example: swarmctl health info uav1
    """
    from swarmctl.output import Column
    from swarmctl.quantities import spoken
    from swarmctl.session import Session, run
    from swarmware import names
    from swarmware.types.health import HealthReport
    from swarmware.types.rpc import Empty

    async def work(session: Session) -> None:
        target = names.check_platform(platform or session.platform)
        report = await session.ask(f"/{target}/sys/health/state", Empty(), HealthReport)
        if session.settings.json:
            session.out.document(report)
            return
        rows = [
            (
                check.check,
                check.app,
                check.state,
                check.level,
                f"{check.frequency_hz:g}",
                # a check that never changed has no instant: it is so since the monitor started
                spoken((report.stamp_ns - check.since_ns) / 1e9) if check.since_ns else "start",
            )
            for check in report.checks
        ]
        columns = [
            Column("CHECK"),
            Column("BY"),
            Column("STATE"),
            Column("LEVEL"),
            Column("HZ", right=True),
            Column("SINCE", right=True),
        ]
        session.out.table(columns, rows, f"{report.platform}: {report.state.level}")

    run(settings(ctx), work)


@cmd.command()
@click.option("--cleared", is_flag=True, help="Also those that are over.")
@click.pass_context
def faults(ctx: click.Context, cleared: bool) -> None:
    """List the faults of a platform, newest first.

    Example: swarmctl health faults --node uav1 --cleared
    """
    from swarmctl.output import Column
    from swarmctl.quantities import spoken
    from swarmctl.session import Session, run
    from swarmware.types.health import FaultList, FaultQuery

    async def work(session: Session) -> None:
        found = await session.ask("sys/health/faults", FaultQuery(cleared), FaultList)
        if session.settings.json:
            session.out.document(found)
            return
        if not found.faults:
            session.out.say(
                f"{found.platform}: no faults" + ("" if cleared else "; --cleared shows those over")
            )
            return
        rows = [
            (
                fault.check,
                fault.state,
                fault.level,
                str(fault.phase),
                fault.count,
                spoken((found.stamp_ns - fault.first_ns) / 1e9),
                spoken((found.stamp_ns - fault.last_ns) / 1e9),
                fault.what,
            )
            for fault in found.faults
        ]
        columns = [
            Column("CHECK"),
            Column("STATE"),
            Column("LEVEL"),
            Column("PHASE"),
            Column("COUNT", right=True),
            Column("FIRST AGO", right=True),
            Column("LAST AGO", right=True),
            Column("WHAT"),
        ]
        session.out.table(columns, rows)

    run(settings(ctx), work)


@cmd.command()
@click.argument("pattern", default="**")
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.pass_context
def clear(ctx: click.Context, pattern: str, yes: bool) -> None:
    """End the faults of a platform whose check matches, and forget applications and platforms that are gone.

    What goes on and is still wrong becomes a new fault.

    Example: swarmctl health clear 'age/sensor/**' --node uav1
    """
    import sys

    from swarmctl.session import Session, run
    from swarmware.errors import NotFound
    from swarmware.names import Pattern
    from swarmware.types.health import FaultClear, FaultList

    Pattern(pattern)  # one that is none is refused before anybody is asked
    what = f"clear the faults that match {pattern}"
    if not yes:
        if not sys.stdin.isatty():
            raise click.UsageError(f"{what}: expected --yes, because nobody can be asked here")
        click.confirm(f"{what}. Go on?", abort=True, err=True)

    async def work(session: Session) -> None:
        cleared = await session.ask("sys/health/clear", FaultClear(pattern), FaultList)
        if not cleared.faults and pattern != "**":
            raise NotFound(f"{cleared.platform}: no fault matches {pattern}; `health faults` lists them")
        if session.settings.json:
            session.out.document(cleared)
        for fault in cleared.faults:
            session.out.say(f"{cleared.platform}: {fault.check}: {fault.state} cleared")

    run(settings(ctx), work)
