"""Outages of the links of a platform, from its broker."""

from swarmctl.session.session import Session
from swarmctl.terminal.quantities import utc_text
from swarmctl.terminal.table import Column
from swarmware.types.outage import LinkOutage, OutageTable
from swarmware.types.rpc import Empty


async def list_outages(session: Session, count: int | None) -> None:
    """Prints the newest outages; `count` None: all that the node keeps."""
    found = await session.ask("sys/broker/outages", Empty(), OutageTable)
    if count is not None:
        found = OutageTable(found.outages[:count])
    if session.settings.structured:
        session.out.document(found)
        return
    columns = [
        Column("NEIGHBOUR"),
        Column("SINCE"),
        Column("CAUSE", drop=2),
        Column("STATE"),
        Column("DETECTED AFTER s", right=True),
        Column("DOWN FOR s", right=True),
        Column("RECOVERED IN s", right=True),
        Column("DRAINED IN s", right=True),
        Column("BACKLOG", right=True, drop=1),
    ]
    empty = f"{session.platform}: no link was lost since it was up"
    session.out.table(columns, [_row(one) for one in found.outages], empty=empty)


def _row(one: LinkOutage) -> tuple[str | int | None, ...]:
    return (
        one.name,
        utc_text(one.began_utc_ns),
        one.cause,
        one.phase,
        _seconds(one.detected_after_s),
        _seconds(one.down_for_s),
        _seconds(one.recovered_in_s),
        _seconds(one.drained_in_s),
        one.backlog_frames,
    )


def _seconds(span_s: float | None) -> str | None:
    return None if span_s is None else f"{span_s:.2f}"
