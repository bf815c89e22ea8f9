"""`swarmctl node`: nodes of the swarm."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM
from swarmctl.commandline.settings import settings
from swarmctl.vehicles.options import timeout_option


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


@cmd.command()
@click.argument("platform", required=False, type=PLATFORM)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option("--force", is_flag=True, help="Also of an armed vehicle.")
@timeout_option(30.0)
@click.pass_context
def restart(ctx: click.Context, platform: str | None, yes: bool, force: bool, wait_s: float) -> None:
    """Restart all services of a node by its guard, one after the other; the time-out is that of each.

    An armed vehicle is refused, unless --force is given.

    Example: swarmctl node restart uav1 --yes
    """
    from swarmctl.resources.restart import restart
    from swarmctl.session.session import run

    run(settings(ctx), restart, platform or "", (), wait_s, yes=yes, force=force)
