"""Log of the changes requested from a platform, including refused ones."""

from typing import Any

import msgspec

from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import span_s, utc_text
from swarmctl.terminal.table import Column
from swarmware.model import names
from swarmware.model.clock import utc_ns
from swarmware.types.tree import LoggedChange, TreeLog, TreeLogQuery


class RecordedChange(msgspec.Struct, frozen=True):
    """A requested change, which was made or refused."""

    utc_ns: int
    """Time of the request on the platform's wall clock."""
    path: str
    by: str
    """`role@platform` of the requester, or `application@platform` on the platform itself."""
    before: Any
    """Former value, or None without a known one."""
    after: Any
    """New value, or None if the change was refused."""
    refused: str
    """Reason of the refusal, or "" if the change was made."""


class ChangeRecord(msgspec.Struct, frozen=True):
    """Changes requested from a platform, the newest first."""

    changes: list[RecordedChange]
    platform: str
    more: int
    """Number of older matching changes that are not shown."""


async def print_log(
    session: Session, pattern: str, *, by: str, since: str, refused: bool, count: int
) -> None:
    """Prints the requester, time, resource and result of each change.

    Raises: NotFound, NoAnswer, Denied; InvalidInput for an invalid pattern or time.
    """
    since_utc_ns = utc_ns() - round(span_s(since) * 1e9) if since else 0
    query = TreeLogQuery(names.Pattern(pattern).text, by, since_utc_ns, refused, count)
    await session.reach(session.platform)
    found = await session.ask(names.join(session.platform, "sys/tree/log"), query, TreeLog)
    logged, more = list(found.changes), found.more
    # each computer of a platform records the requests that its own tree got
    for other in await session.other_computers(session.platform):
        there = await session.ask(names.join(other, "sys/tree/log"), query, TreeLog)
        logged, more = [*logged, *there.changes], more + there.more
    logged.sort(key=lambda one: one.utc_ns, reverse=True)
    # each computer has answered with up to `count`, so together they may be too many
    more += len(logged[count:])
    changes = [_recorded(one) for one in logged[:count]]
    if session.settings.structured:
        session.out.document(ChangeRecord(changes, found.platform, more))
        return
    columns = [
        Column("AT"),
        Column("PATH"),
        Column("BEFORE"),
        Column("AFTER"),
        Column("BY"),
    ]
    rows = [
        (
            utc_text(one.utc_ns),
            names.split(one.path)[1],
            None if one.before is None else brief(one.before),
            f"refused: {one.refused}" if one.refused else brief(one.after),
            one.by,
        )
        for one in changes
    ]
    session.out.table(columns, rows, empty=f"{found.platform}: no recorded change matches")
    if more:
        session.out.say(f"{more} older changes; --count shows more")


def _recorded(one: LoggedChange) -> RecordedChange:
    change = one.change
    return RecordedChange(
        one.utc_ns, change.path, change.by, _plain(change.before), _plain(change.after), change.refused
    )


def _plain(text: str) -> Any:
    """The value of a JSON text, without the Struct of a single field; any other text stays unchanged."""
    if not text:
        return None
    try:
        found = msgspec.json.decode(text)
    except msgspec.DecodeError:
        return text
    # a Struct of one field is a list of one item on the wire
    return found[0] if isinstance(found, list) and len(found) == 1 else found
