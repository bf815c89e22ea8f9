"""`swarmctl node`: nodes of the swarm."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM
from swarmctl.commandline.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Nodes of the swarm.

    Example: swarmctl node ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the nodes: whether they answer, health, mission; mode, armed, height and battery of vehicles.

    Example: swarmctl node ls --json
    """
    from swarmctl.commands.node.overview import list_nodes
    from swarmctl.session.session import run

    run(settings(ctx), list_nodes)


@cmd.command()
@click.argument("platform", required=False, type=PLATFORM)
@click.pass_context
def info(ctx: click.Context, platform: str | None) -> None:
    """Show one node: identity, services, and path of its configuration.

    Example: swarmctl node info uav1
    """
    from swarmctl.commands.node.overview import show_node
    from swarmctl.session.session import run

    run(settings(ctx), show_node, platform or "")
