"""Neighbours of a platform, from its broker."""

from swarmctl.session.session import Session
from swarmctl.terminal.table import Cell, Column
from swarmware.types.net import MediumState, MediumUse, Neighbours, NeighbourState
from swarmware.types.rpc import Empty


async def list_neighbours(session: Session) -> None:
    """Prints state, address, loss, round trip and cost of each."""
    found = await session.ask("sys/broker/links", Empty(), Neighbours)
    if session.settings.structured:
        session.out.document(found)
        return
    rows: list[tuple[Cell, ...]] = []
    for one in found.neighbours:
        rows.append(_row(one))
        rows += map(_medium_row, one.media)
    columns = [
        Column("NEIGHBOUR"),
        Column("STATE"),
        Column("ADDRESS", drop=1),
        Column("MESSAGES", drop=2),
        Column("BEACON", drop=3),
        Column("LOSS IN", right=True),
        Column("LOSS OUT", right=True),
        Column("RTT ms", right=True),
        Column("ETX", right=True),
        Column("HZ", right=True),
        Column("SILENT s", right=True),
    ]
    empty = f"{session.platform}: no neighbours; `swarmctl doctor` checks the network of a node"
    session.out.table(columns, rows, empty=empty)


def _row(one: NeighbourState) -> tuple[Cell, ...]:
    return (
        one.platform or f"{one.hardware:08x}",
        one.state,
        one.address,
        one.transport,
        "multicast" if one.multicast else "unicast",
        f"{one.loss_in_ratio * 100:.0f} %",
        f"{one.loss_out_ratio * 100:.0f} %",
        None if one.rtt_ms is None else f"{one.rtt_ms:.2f}",
        None if one.cost >= 65535 else f"{one.cost / 256:.2f}",
        f"{one.tick_hz:.1f}",
        f"{one.silent_s:.1f}",
    )


def _medium_row(one: MediumState) -> tuple[Cell, ...]:
    """One of several media to the neighbour of the row above; frames out, in, or both ways by it."""
    return (
        f"  by {one.medium}",
        one.state,
        one.address,
        "" if one.use == MediumUse.NONE else f"frames {one.use}",
        "",
        f"{one.loss_in_ratio * 100:.0f} %",
        f"{one.loss_out_ratio * 100:.0f} %",
        None,
        None if one.cost >= 65535 else f"{one.cost / 256:.2f}",
        "",
        f"{one.silent_s:.1f}",
    )
