"""`swarmctl log`: query, follow and export what was recorded."""

from typing import TYPE_CHECKING, Any

import click

from swarmctl import completion
from swarmctl.completion_cache import VALUED
from swarmctl.lazy import Group
from swarmctl.settings import settings

if TYPE_CHECKING:
    from collections.abc import Callable


def _source_options(function: "Callable[..., Any]") -> "Callable[..., Any]":
    for option in (
        click.option("--dir", "folder", metavar="DIR", help="A folder of segments, or a report's folder."),
        click.option("--spool", metavar="FILE", help="A stream of MessagePack; `-` for stdin."),
        click.option(
            "--mongodb",
            metavar="URI",
            help="The database instead of local segments; `-`: where they go.",
        ),
        click.option("--database", metavar="NAME", help="Of the database; else the one the logs go to."),
    ):
        function = option(function)
    return function


def _query_options(function: "Callable[..., Any]") -> "Callable[..., Any]":
    for option in (
        click.argument("pattern", default="/**", shell_complete=completion.resources(VALUED)),
        click.option("--type", "types", multiple=True, metavar="TYPE", help="Only values of this type."),
        click.option("--since", metavar="TIME", help="From: 30s, 5m, 2h ago, or an ISO date."),
        click.option("--until", metavar="TIME", help="To, as --since."),
        click.option("--limit", type=click.IntRange(min=1), metavar="N", help="At most N, the oldest."),
        click.option("--newest", is_flag=True, help="With --limit: the newest instead."),
    ):
        function = option(function)
    return function


@click.group(cls=Group)
def cmd() -> None:
    """Query, follow and export what was recorded.

    Example: swarmctl log query '/uav1/nav/*' --since 30s
    """


@cmd.command()
@_query_options
@_source_options
@click.pass_context
def query(ctx: click.Context, /, **options: Any) -> None:
    """Print the entries of paths that match a pattern.

    Example: swarmctl log query '/uav1/nav/*' --since 30s --limit 20
    """
    from swarmctl.commands.log import sources
    from swarmctl.output import Output

    out = Output(settings(ctx))
    with sources.source(settings(ctx), options) as found:
        count = 0
        for entry in found.entries(sources.query(settings(ctx), options)):
            sources.show(out, entry)
            count += 1
    if not count:
        out.say(found.nothing() or "no entry matches")
    sources.refuse_losses(found)


@cmd.command()
@click.argument("pattern", default="/**", shell_complete=completion.resources(VALUED))
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N entries.")
@click.pass_context
def tail(ctx: click.Context, pattern: str, count: int | None) -> None:
    """Follow what the loggers of this machine's nodes record from now on, in order of time; Ctrl-C ends it.

    Example: swarmctl log tail '/uav1/mission/**' --json
    """
    from itertools import islice

    from swarmctl.commands.log import sources, tail
    from swarmctl.output import Output

    out = Output(settings(ctx))
    for entry in islice(tail.follow(settings(ctx), pattern), count):
        sources.show(out, entry)


@cmd.command()
@_query_options
@_source_options
@click.option(
    "--format",
    "form",
    type=click.Choice(["jsonl", "csv", "mcap", "msgpack"]),
    default="jsonl",
    show_default=True,
    help="JSON Lines, CSV, MCAP with JSON, or a stream of MessagePack.",
)
@click.option("--out", "target", required=True, metavar="FILE", help="File to write; `-` for stdout.")
@click.pass_context
def export(ctx: click.Context, /, form: str, target: str, **options: Any) -> None:
    """Write entries to a file that other tools read.

    Example: swarmctl log export '/*/nav/pose' --format csv --out poses.csv
    """
    from swarmctl.commands.log import sources
    from swarmctl.commands.log.export import export as write
    from swarmctl.output import Output

    with sources.source(settings(ctx), options) as found:
        count = write(found.entries(sources.query(settings(ctx), options)), form, target)
    Output(settings(ctx)).say(f"{count} entries to {target}")
    sources.refuse_losses(found)


@cmd.command()
@_source_options
@click.option("--strict", is_flag=True, help="Exit with 3 when anything is missing.")
@click.pass_context
def stats(ctx: click.Context, /, strict: bool, **options: Any) -> None:
    """Count the entries of each queue, and those that are missing.

    Example: swarmctl log stats --node uav1
    """
    from swarmctl.commands.log import sources
    from swarmctl.output import Column, Output
    from swarmware.errors import Partial
    from swarmware.record.query import Query
    from swarmware.record.query import stats as count

    out = Output(settings(ctx))
    with sources.source(settings(ctx), options) as found:
        queues = count(found.entries(Query()))
    if settings(ctx).json:
        out.document({"queues": queues})
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
        out.table(columns, rows)
    sources.refuse_losses(found)
    if strict and (missing := sum(queue.missing for queue in queues)):
        raise Partial(f"log: {missing} entries are missing; expected none")
