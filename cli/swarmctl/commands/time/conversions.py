"""Conversion functions from the clock of one platform to the clocks of the others."""

from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.types.rpc import Empty
from swarmware.types.time import TimeFunctions


async def list_conversions(session: Session) -> None:
    """Prints offset, skew, bound and age of each."""
    found = await session.ask("sys/time/functions", Empty(), TimeFunctions)
    if session.settings.structured:
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
        Column("SIGMA us", right=True, drop=2),
        Column("AGE s", right=True, drop=1),
        Column("HOPS", right=True, drop=3),
        Column("VIA", drop=4),
        Column("SAMPLES", right=True, drop=5),
        Column("SUSPECT"),
    ]
    empty = f"{session.platform}: the clock of no other node is known"
    session.out.table(columns, rows, "OFFSET: that clock minus the clock of the node", empty=empty)
