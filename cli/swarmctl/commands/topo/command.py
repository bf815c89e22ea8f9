"""`swarmctl topo`: the links of the swarm as a graph."""

import click

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.settings import settings


@click.command(cls=Command)
@click.option("--dot", is_flag=True, help="Print a Graphviz graph.")
@click.option("--png", metavar="FILE", help="Write a picture.")
@click.option(
    "--watch", is_flag=True, help="Draw a map each second, nodes at their positions; Ctrl-C ends it."
)
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="With --watch: end after N maps.")
@click.pass_context
def cmd(ctx: click.Context, dot: bool, png: str | None, watch: bool, count: int | None) -> None:
    """Show the links of the swarm as a graph, from the neighbour tables of all platforms, or of the selected.

    Example: swarmctl topo --dot | neato -Tsvg > swarm.svg
    """
    from swarmctl.commands.topo.topology import show_topology, watch_topology
    from swarmctl.session.session import run

    if dot and png:
        raise click.UsageError("--dot or --png FILE, not both")
    if dot and settings(ctx).structured:
        raise click.UsageError(f"--dot or -o {settings(ctx).output}, not both")
    if watch and (dot or png):
        raise click.UsageError("--watch draws a map; expected no --dot or --png")
    if count is not None and not watch:
        raise click.UsageError("--count N ends --watch; expected both")
    if watch:
        run(settings(ctx), watch_topology, count)
    else:
        run(settings(ctx), show_topology, dot=dot, png=png or "")
