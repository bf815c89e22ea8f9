"""`swarmctl health`: state and faults of the nodes."""

import click

from swarmctl.lazy import Group
from swarmctl.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """State and faults of the nodes.

    Example: swarmctl health ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """Show the state of one platform and each of its checks.

    Example: swarmctl health ls --node uav1
    """
    from swarmctl.connect import Link, run
    from swarmctl.output import Column
    from swarmware.types.health import HealthReport
    from swarmware.types.rpc import Empty

    async def work(link: Link) -> None:
        report = await link.ask("sys/health/state", Empty(), HealthReport)
        if link.settings.json:
            link.out.document(report)
            return
        state = report.state
        link.out.text(
            f"{report.platform}: {state.level}, battery {state.battery}, "
            f"{state.apps_alive} applications alive, {state.apps_failed} failed, "
            f"guard {state.guard}, {state.fault_count} faults"
        )
        rows = [
            (check.check, check.app, check.state, check.level, (report.stamp_ns - check.since_ns) / 1e9)
            for check in report.checks
        ]
        link.out.table(
            [Column("CHECK"), Column("BY"), Column("STATE"), Column("LEVEL"), Column("SINCE s", right=True)],
            rows,
        )

    run(settings(ctx), work)


@cmd.command()
@click.option("--cleared", is_flag=True, help="Also those that are over.")
@click.pass_context
def faults(ctx: click.Context, cleared: bool) -> None:
    """List the faults of a platform, newest first.

    Example: swarmctl health faults --node uav1 --cleared
    """
    from swarmctl.connect import Link, run
    from swarmctl.output import Column
    from swarmware.types.health import FaultList, FaultQuery

    async def work(link: Link) -> None:
        found = await link.ask("sys/health/faults", FaultQuery(cleared), FaultList)
        if link.settings.json:
            link.out.document(found)
            return
        rows = [
            (
                fault.check,
                fault.state,
                fault.level,
                str(fault.phase),
                fault.count,
                (found.stamp_ns - fault.first_ns) / 1e9,
                (found.stamp_ns - fault.last_ns) / 1e9,
                fault.message or fault.freeze,
            )
            for fault in found.faults
        ]
        columns = [
            Column("CHECK"),
            Column("STATE"),
            Column("LEVEL"),
            Column("PHASE"),
            Column("COUNT", right=True),
            Column("FIRST s AGO", right=True),
            Column("LAST s AGO", right=True),
            Column("WHAT"),
        ]
        link.out.table(columns, rows)

    run(settings(ctx), work)
