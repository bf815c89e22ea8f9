"""Prints, exports and counts log entries."""

import asyncio
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import msgspec

from swarmctl.commands.log import export, sources, tail
from swarmctl.commands.log.origins import origins as map_origins
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmctl.viewers.lost_values import LostValues
from swarmware.errors import Partial
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.query import LogSource, Query, QueueStats, stats


class LogStatistics(msgspec.Struct, frozen=True):
    """Number of entries of each queue."""

    queues: list[QueueStats]


def print_entries(options: Mapping[str, Any], out: Output) -> None:
    """Prints the entries that the options name.

    Raises: Partial when a part of the log could not be read; as `sources.source`.
    """
    with sources.source(out.settings, options) as found:
        count = 0
        for entry in _selected(found, options, out):
            sources.show(out, entry)
            count += 1
    if not count:
        out.say(found.why_empty() or "no entry matches")
    sources.refuse_losses(found)


def _selected(found: LogSource, options: Mapping[str, Any], out: Output) -> Iterator[LogEntry]:
    """The entries that the options name; reports whether `--limit` leaves others out."""
    query = sources.query(out.settings, options)
    if query.limit is None:
        yield from found.entries(query)
        return
    entries = list(found.entries(msgspec.structs.replace(query, limit=query.limit + 1)))
    others = len(entries) > query.limit
    yield from entries[-query.limit :] if query.newest else entries[: query.limit]
    if others:
        out.say(f"--limit {query.limit}: {'older' if query.newest else 'newer'} entries are left out")


def follow_entries(pattern: str, count: int | None, out: Output) -> None:
    """Prints new entries that match; ends after `count`, when one is given.

    Raises: as `tail.follow`.
    """
    asyncio.run(tail.follow(out.settings, pattern, partial(sources.show, out), count))


def export_entries(options: Mapping[str, Any], form: str, target: str, out: Output) -> None:
    """Writes the entries that the options name to a file.

    Raises: NotFound when no entry matches; Partial when a part could not be read, or the format cannot hold
    a value; as `sources.source`.
    """
    lost = LostValues()
    with sources.source(out.settings, options) as found:
        origins = map_origins(options, out) if form == "mcap" else {}
        count = export.export(_selected(found, options, out), form, target, origins, lost)
    out.say(f"{count} entries to {target}")
    sources.refuse_losses(found)
    lost.refuse()


def count_entries(options: Mapping[str, Any], out: Output, *, strict: bool) -> None:
    """Prints the number of entries and of missing entries of each queue.

    Raises: Partial when a part could not be read, or with `strict` when entries are missing.
    """
    with sources.source(out.settings, options) as found:
        queues = stats(found.entries(Query()))
    if out.settings.structured:
        out.document(LogStatistics(queues))
    else:
        rows = [
            (q.queue, q.entries, q.bytes, q.missing, (q.last_utc_ns - q.first_utc_ns) / 1e9) for q in queues
        ]
        columns = [
            Column("QUEUE"),
            Column("ENTRIES", right=True),
            Column("BYTES", right=True),
            Column("MISSING", right=True),
            Column("SPAN s", right=True),
        ]
        out.table(columns, rows, empty="the log has no entries")
    sources.refuse_losses(found)
    if strict and (missing := sum(queue.missing for queue in queues)):
        raise Partial(f"log: {missing} entries are missing; expected none")
