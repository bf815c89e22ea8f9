"""Counters of a platform's broker since its start."""

from typing import Final

import msgspec

from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.types.net import UNACCEPTED
from swarmware.types.rpc import Empty
from swarmware.types.traffic import Traffic

_DROP: Final = {"DUPLICATE": 7, "LATE": 6, "HELD BACK": 5, "MAX HZ": 4, "DROPPED": 3, "LOST": 2, "OFFERED": 1}
"""Columns that a narrow terminal hides, the highest number first."""


async def list_counters(session: Session) -> None:
    """Prints the counters of each link and channel, and of refused input."""
    found = await session.ask("sys/broker/traffic", Empty(), Traffic)
    if session.settings.structured:
        session.out.document(found)
        return
    names: tuple[str, ...] = (
        "SENT",
        "BYTES",
        "RECEIVED",
        "BYTES",
        "LOST",
        "LATE",
        "DUPLICATE",
        "DROPPED",
    )
    columns = [Column("LINK"), Column("BY"), *map(_number, names)]
    rows = [
        (
            "unaccepted" if one.platform == UNACCEPTED else one.platform,
            one.transport,
            one.sent_frames,
            one.sent_bytes,
            one.received_frames,
            one.received_bytes,
            one.lost,
            one.late,
            one.duplicates,
            one.dropped,
        )
        for one in found.links
    ]
    session.out.table(columns, rows, empty=f"{session.platform}: no links")
    session.out.text("")
    names = (
        "OFFERED",
        "SENT",
        "BYTES",
        "RECEIVED",
        "BYTES",
        "LATE",
        "DUPLICATE",
        "DROPPED",
        "MAX HZ",
        "HELD BACK",
    )
    columns = [Column("CHANNEL"), *map(_number, names)]
    channels = [
        (
            one.channel,
            one.offered_frames,
            one.sent_frames,
            one.sent_bytes,
            one.received_frames,
            one.received_bytes,
            one.late,
            one.duplicates,
            one.dropped,
            one.max_hz,
            one.held_back,
        )
        for one in found.channels
    ]
    session.out.table(columns, channels, empty=f"{session.platform}: no channels")
    session.out.text("")
    counts = msgspec.structs.asdict(found.refused).items()
    refused = ", ".join(f"{count} {name}" for name, count in counts if count) or "nothing"
    session.out.text(
        f"refused: {refused}; requests answered: {found.requests}; values received: {found.notifications}"
    )
    # shown after an overload only, as it explains late values
    if found.slowed_ticks:
        session.out.text(
            f"processor overloaded: beacons {found.slowdown:g} times rarer ({found.slowed_ticks} so far)"
        )


def _number(name: str) -> Column:
    return Column(name, right=True, drop=_DROP.get(name, 0))
