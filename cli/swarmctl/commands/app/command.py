"""`swarmctl app`: applications that run on the nodes."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import timeout_option
from swarmctl.commandline.settings import settings


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
@click.argument("services", nargs=-1, required=True, metavar="NAME…", shell_complete=completion.services)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option("--force", is_flag=True, help="Also services with which an armed vehicle flies.")
@timeout_option(30.0)
@click.pass_context
def restart(ctx: click.Context, services: tuple[str, ...], yes: bool, force: bool, wait_s: float) -> None:
    """Restart services of platforms by their guards, one after the other, and wait until each runs again.

    On an armed vehicle the services with which it flies are refused, unless --force is given.

    Example: swarmctl app restart logger --node uav1 --yes
    """
    from swarmctl.resources.restart import restart
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), restart, services, wait_s, yes=yes, force=force)


@cmd.command()
@click.argument("services", nargs=-1, required=True, metavar="NAME…", shell_complete=completion.services)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option("--force", is_flag=True, help="Also services with which an armed vehicle flies.")
@timeout_option(30.0)
@click.pass_context
def stop(ctx: click.Context, services: tuple[str, ...], yes: bool, force: bool, wait_s: float) -> None:
    """Stop services of platforms: the guard starts them again after `app start` or a start of the node.

    No fault is raised, and `app ls` shows who stopped them. The broker and the guard cannot be stopped, and
    the services with which an armed vehicle flies only by --force. Services that are units of systemd are
    stopped by systemctl.

    Example: swarmctl app stop logger --node uav1 --yes
    """
    from swarmctl.commands.app import stopping
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), stopping.stop, services, wait_s, yes=yes, force=force)


@cmd.command()
@click.argument("services", nargs=-1, required=True, metavar="NAME…", shell_complete=completion.services)
@timeout_option(30.0)
@click.pass_context
def start(ctx: click.Context, services: tuple[str, ...], wait_s: float) -> None:
    """Start services of platforms that were stopped or given up, and wait until each runs.

    Example: swarmctl app start logger --node uav1
    """
    from swarmctl.commands.app import stopping
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), stopping.start, services, wait_s)
