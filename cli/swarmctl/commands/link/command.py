"""`swarmctl link`: links and their quality."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Links, their quality and their outages.

    Example: swarmctl link ls --node uav1
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the neighbours of a platform, with loss in both directions, round-trip time and cost, for each of
    several media to one neighbour.

    Example: swarmctl link ls --node uav1
    """
    from swarmctl.commands.link.neighbours import list_neighbours
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), list_neighbours)


@cmd.command()
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="The newest N of each node.")
@click.pass_context
def outages(ctx: click.Context, count: int | None) -> None:
    """List the outages of links, the newest first, with their times of detection, recovery and draining.

    Example: swarmctl link outages --node uav1
    """
    from swarmctl.commands.link.outages import list_outages
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), list_outages, count)
