"""Conversion functions from the clock of one platform to the clocks of the others.

The service `timesync` of the platform computes them; nothing here sets a clock.
"""

from swarmctl.session.session import Session
from swarmctl.terminal.table import Detail, rows_of
from swarmware.types.rpc import Empty
from swarmware.types.time import Conversion, TimeFunctions


async def list_conversions(session: Session) -> None:
    """Prints offset, skew, bound and age of each conversion.

    Units: offset in s (that clock minus the own one), skew in ppm, bound and standard deviation in µs.
    Raises: NotFound, NoAnswer without an answer of the time service.
    """
    found = await session.ask("sys/time/functions", Empty(), TimeFunctions)
    if session.settings.structured:
        session.out.document(found)
        return
    # a narrow terminal drops the columns that only explain a bound: age, deviation, hops, way, samples
    details: list[Detail[Conversion]] = [
        Detail("CLOCK", value=lambda one: f"{one.platform}.{one.unit}"),
        Detail("OFFSET s", value=lambda one: f"{one.offset_ns / 1e9:+.6f}", right=True),
        Detail("SKEW ppm", value=lambda one: f"{one.skew * 1e6:+.3f}", right=True),
        Detail("BOUND us", value=lambda one: f"{one.bound_ns / 1e3:.0f}", right=True),
        Detail("SIGMA us", value=lambda one: f"{one.sigma_ns / 1e3:.1f}", right=True, drop=2),
        # on the clock of the answering node, as this computer may have another one
        Detail("AGE s", value=lambda one: f"{(found.stamp_ns - one.t0_ns) / 1e9:.1f}", right=True, drop=1),
        Detail("HOPS", value=lambda one: one.hops, right=True, drop=3),
        Detail("VIA", value=lambda one: one.via, drop=4),
        Detail("SAMPLES", value=lambda one: one.samples, right=True, drop=5),
        Detail("SUSPECT", value=lambda one: one.suspect),
    ]
    empty = f"{session.platform}: the clock of no other node is known"
    session.out.table(
        details,
        rows_of(details, found.functions),
        "OFFSET: that clock minus the clock of the node",
        empty=empty,
    )
