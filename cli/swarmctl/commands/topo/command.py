"""`swarmctl topo`: the links of the swarm as a graph."""

import click

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.settings import settings


@click.command(cls=Command)
@click.option("--dot", is_flag=True, help="Print a Graphviz graph.")
@click.option("--png", metavar="FILE", help="Write a picture.")
@click.pass_context
def cmd(ctx: click.Context, dot: bool, png: str | None) -> None:
    """Show the links of the swarm as a graph, from the neighbour tables of all platforms, or of the selected.

    Example: swarmctl topo --dot | neato -Tsvg > swarm.svg
    """
    from swarmctl.commands.topo.topology import show_topology
    from swarmctl.session.session import run

    if dot and png:
        raise click.UsageError("--dot or --png FILE, not both")
    if dot and settings(ctx).structured:
        raise click.UsageError(f"--dot or -o {settings(ctx).output}, not both")
    run(settings(ctx), show_topology, dot=dot, png=png or "")
