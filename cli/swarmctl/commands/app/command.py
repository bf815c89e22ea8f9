"""`swarmctl app`: applications that run on the nodes."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Applications that run on the nodes.

    Example: swarmctl app ls --node uav1
    """


@cmd.command()
@click.option("--all", "everywhere", is_flag=True, help="Applications of all known platforms.")
@click.pass_context
def ls(ctx: click.Context, everywhere: bool) -> None:
    """List the applications of a platform.

    Example: swarmctl app ls --node uav1
    """
    from swarmctl.commands.app.listing import list_applications
    from swarmctl.session.session import run

    run(settings(ctx), list_applications, everywhere)
