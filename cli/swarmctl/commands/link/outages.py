"""Outages of the links of a platform, from its broker."""

from swarmctl.session.session import Session
from swarmctl.terminal.quantities import utc_text
from swarmctl.terminal.table import Detail, rows_of
from swarmware.types.outage import LinkOutage, OutageTable
from swarmware.types.rpc import Empty


async def list_outages(session: Session, count: int | None) -> None:
    """Prints the newest outages: at most `count`, or all that the node keeps if it is None.

    Units: the four times of an outage in s: to detect it, down, to recover, to drain the backlog.
    Raises: NotFound, NoAnswer without an answer of the broker.
    """
    found = await session.ask("sys/broker/outages", Empty(), OutageTable)
    # before the output, so that a program gets as many as a person
    if count is not None:
        found = OutageTable(found.outages[:count])
    if session.settings.structured:
        session.out.document(found)
        return
    details: list[Detail[LinkOutage]] = [
        Detail("NEIGHBOUR", value=lambda one: one.name),
        Detail("SINCE", value=lambda one: utc_text(one.began_utc_ns)),
        Detail("CAUSE", value=lambda one: one.cause, drop=2),
        Detail("STATE", value=lambda one: one.phase),
        Detail("DETECTED AFTER s", value=lambda one: _seconds(one.detected_after_s), right=True),
        Detail("DOWN FOR s", value=lambda one: _seconds(one.down_for_s), right=True),
        Detail("RECOVERED IN s", value=lambda one: _seconds(one.recovered_in_s), right=True),
        Detail("DRAINED IN s", value=lambda one: _seconds(one.drained_in_s), right=True),
        Detail("BACKLOG", value=lambda one: one.backlog_frames, right=True, drop=1),
    ]
    empty = f"{session.platform}: no link was lost since it was up"
    session.out.table(details, rows_of(details, found.outages), empty=empty)


def _seconds(span_s: float | None) -> str | None:
    """A time of an outage as text, or None if it is not over yet."""
    return None if span_s is None else f"{span_s:.2f}"
