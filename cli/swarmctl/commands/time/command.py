"""`swarmctl time`: clock conversions between nodes."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Clock conversions between nodes: clocks are never set, stamps are converted.

    Example: swarmctl time ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the conversions from the clock of a platform to all others: offset, skew and error bounds.

    Example: swarmctl time ls --node uav1
    """
    from swarmctl.commands.time.conversions import list_conversions
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), list_conversions)
