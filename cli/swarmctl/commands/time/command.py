"""`swarmctl time`: clock conversions between nodes."""

import click

from swarmctl.lazy import Group
from swarmctl.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Clock conversions between nodes: clocks are never set, stamps are converted.

    Example: swarmctl time ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List how the clocks of the others stand to the clock of a platform, and how well that is known.

    Example: swarmctl time ls --node uav1
    """
    from swarmctl.output import Column
    from swarmctl.session import Session, run
    from swarmware.types.rpc import Empty
    from swarmware.types.time import TimeFunctions

    async def work(session: Session) -> None:
        found = await session.ask("sys/time/functions", Empty(), TimeFunctions)
        if session.settings.json:
            session.out.document(found)
            return
        rows = [
            (
                f"{one.platform}.{one.unit}",
                f"{one.offset_ns / 1e9:+.6f}",
                f"{one.skew * 1e6:+.3f}",
                f"{one.bound_ns / 1e3:.0f}",
                f"{one.sigma_ns / 1e3:.1f}",
                f"{(found.stamp_ns - one.t0_ns) / 1e9:.1f}",
                one.hops,
                one.via,
                one.samples,
                one.suspect,
            )
            for one in found.functions
        ]
        columns = [
            Column("CLOCK"),
            Column("OFFSET s", right=True),
            Column("SKEW ppm", right=True),
            Column("BOUND us", right=True),
            Column("SIGMA us", right=True),
            Column("AGE s", right=True),
            Column("HOPS", right=True),
            Column("VIA"),
            Column("SAMPLES", right=True),
            Column("SUSPECT"),
        ]
        session.out.table(columns, rows, "theirs minus that of " + session.platform)

    run(settings(ctx), work)
