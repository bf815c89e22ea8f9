"""`swarmctl app`: applications that run on the nodes."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import settings
from swarmctl.vehicles.options import timeout_option


@click.group(cls=Group)
def cmd() -> None:
    """Applications that run on the nodes.

    Example: swarmctl app ls --node uav1
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the applications of platforms.

    Example: swarmctl app ls --node uav1
    """
    from swarmctl.commands.app.listing import list_applications
    from swarmctl.session.session import run

    run(settings(ctx), list_applications)


@cmd.command()
@click.argument("services", nargs=-1, required=True, metavar="NAME…")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option("--force", is_flag=True, help="Also services with which an armed vehicle flies.")
@timeout_option(30.0)
@click.pass_context
def restart(ctx: click.Context, services: tuple[str, ...], yes: bool, force: bool, wait_s: float) -> None:
    """Restart services of platforms by their guards, one after the other, and wait until each runs again.

    On an armed vehicle what it flies with is refused, unless --force is given.

    Example: swarmctl app restart logger --node uav1 --yes
    """
    from swarmctl.resources.restart import restart
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), restart, services, wait_s, yes=yes, force=force)
