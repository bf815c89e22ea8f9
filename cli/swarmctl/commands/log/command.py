"""`swarmctl log`: query, follow and export log entries."""

from typing import TYPE_CHECKING, Any

import click

from swarmctl.commandline import completion
from swarmctl.commandline.completion_cache import VALUED
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.secret import SECRET
from swarmctl.commandline.settings import settings

if TYPE_CHECKING:
    from collections.abc import Callable


def _source_options(function: "Callable[..., Any]") -> "Callable[..., Any]":
    for option in (
        click.option("--dir", "folder", metavar="DIR", help="A folder of segments, or a report's folder."),
        click.option("--spool", metavar="FILE", help="A stream of MessagePack; `-` for stdin."),
        click.option(
            "--mongodb",
            type=SECRET,
            metavar="URI",
            help="Read this database instead of local segments: a URI, `-` for the lab's or node's database,"
            " @FILE for a URI in a file, @- for one from stdin.",
        ),
        click.option("--database", metavar="NAME", help="Name of the database; by default the logger's."),
    ):
        function = option(function)
    return function


def _query_options(function: "Callable[..., Any]") -> "Callable[..., Any]":
    for option in (
        click.argument("pattern", default="/**", shell_complete=completion.resources(VALUED)),
        click.option("--type", "types", multiple=True, metavar="TYPE", help="Only values of this type."),
        click.option("--since", metavar="TIME", help="Start: 30s, 5m, 2h ago, or an ISO date."),
        click.option("--until", metavar="TIME", help="End, in the format of --since."),
        click.option(
            "--mission",
            "run_id",
            type=click.IntRange(min=1),
            metavar="ID",
            help="Only the span of this run, from `mission history`.",
        ),
        click.option(
            "--limit", type=click.IntRange(min=1), metavar="N", help="At most N entries, the newest."
        ),
        click.option("--oldest", is_flag=True, help="With --limit: the oldest entries instead."),
    ):
        function = option(function)
    return function


@click.group(cls=Group)
def cmd() -> None:
    """Query, follow and export log entries.

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
    from swarmctl.commands.log.entries import print_entries
    from swarmctl.terminal.output import Output

    print_entries(options, Output(settings(ctx)))


@cmd.command()
@click.argument("pattern", default="/**", shell_complete=completion.resources(VALUED))
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N entries.")
@click.pass_context
def tail(ctx: click.Context, pattern: str, count: int | None) -> None:
    """Follow the new entries of the loggers on this machine, in order of time; Ctrl-C ends it.

    Example: swarmctl log tail '/uav1/mission/**' --json
    """
    from swarmctl.commands.log.tail import follow_entries
    from swarmctl.terminal.output import Output

    follow_entries(pattern, count, Output(settings(ctx)))


@cmd.command()
@_query_options
@_source_options
@click.option(
    "--format",
    "form",
    type=click.Choice(["jsonl", "csv", "parquet", "mcap", "msgpack"]),
    default="jsonl",
    show_default=True,
    help="JSON Lines; CSV or Parquet with one table a type; MCAP for viewers; a stream of MessagePack.",
)
@click.option(
    "--out",
    "target",
    required=True,
    metavar="FILE",
    help="File to write; `-` for stdout, a pipe, too (not Parquet); `NAME/` for a folder, with a file for"
    " each type.",
)
@click.pass_context
def export(ctx: click.Context, /, form: str, target: str, **options: Any) -> None:
    """Write entries to a file that other tools read.

    Example: swarmctl log export --since 10m --format mcap --out flight.mcap
    """
    from swarmctl.commands.log.entries import export_entries
    from swarmctl.terminal.output import Output

    export_entries(options, form, target, Output(settings(ctx)))


@cmd.command()
@_source_options
@click.option("--strict", is_flag=True, help="Exit with 3 when entries are missing.")
@click.pass_context
def stats(ctx: click.Context, /, strict: bool, **options: Any) -> None:
    """Count the entries of each queue, and missing ones.

    Example: swarmctl log stats --node uav1
    """
    from swarmctl.commands.log.entries import count_entries
    from swarmctl.terminal.output import Output

    count_entries(options, Output(settings(ctx)), strict=strict)
