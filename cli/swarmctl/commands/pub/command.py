"""`swarmctl pub`: publish a value as a resource of the joined node."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.lazy import Command
from swarmctl.commandline.settings import Nodes, settings


@click.command(cls=Command, nodes=Nodes.ONE, context_settings={"ignore_unknown_options": True})
@click.argument("path", shell_complete=completion.resources({"board", "event", "stream"}))
@click.argument("value", nargs=-1, required=True, metavar="VALUE…", shell_complete=completion.field_values)
@click.option(
    "--rate",
    "rate_hz",
    type=click.FloatRange(min=0.01, max=1000),
    metavar="HZ",
    help="Repeat at this rate, until Ctrl-C or --count.",
)
@click.option(
    "--count",
    type=click.IntRange(min=1),
    metavar="N",
    help="Number of values; default: one, without end if --rate is given.",
)
@click.option("--type", "type_name", default="", metavar="TYPE", help="Type of a new resource.")
@click.option(
    "--kind",
    type=click.Choice(["board", "event", "stream"]),
    default="board",
    help="Kind of a new resource; default: board.",
)
@click.option(
    "--hold",
    "hold_s",
    type=click.FloatRange(min=0, max=86400),
    default=2.0,
    metavar="SECONDS",
    help="Time for which the resource remains after its last value; default: 2.",
)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def pub(
    ctx: click.Context,
    path: str,
    value: tuple[str, ...],
    rate_hz: float | None,
    count: int | None,
    type_name: str,
    kind: str,
    hold_s: float,
    yes: bool,
) -> None:
    """Publish a value as a board, event or stream of the joined node, as a module does.

    The resource belongs to this command and ends with it; a resource with another owner is refused. VALUE is
    JSON, one plain word, or a word field=value for each field; a plain word needs no --type.

    Example: swarmctl pub test/height 1.5 --rate 10 --count 50
    """
    from swarmctl.commands.pub.publishing import ValuesToPublish, publish
    from swarmctl.session.session import run

    wanted = ValuesToPublish(value, rate_hz, count, type_name, kind, hold_s)
    run(settings(ctx), publish, path, wanted, yes=yes)
