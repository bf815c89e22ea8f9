"""`swarmctl health`: state and faults of the nodes."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import at_nodes, nodes_argument
from swarmctl.commandline.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """State and faults of the nodes.

    Example: swarmctl health ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """Show the state of all or of selected platforms: level, battery, applications, guard, confirmed faults.

    Example: swarmctl health ls
    """
    from swarmctl.commands.health.report import list_states
    from swarmctl.session.session import run

    run(settings(ctx), list_states)


@cmd.command()
@nodes_argument()
@click.pass_context
def info(ctx: click.Context, platforms: tuple[str, ...]) -> None:
    """Show each check of platforms and its present result.

    Example: swarmctl health info uav1
    """
    from swarmctl.commands.health.report import show_checks
    from swarmctl.session.each_node import run_each

    run_each(at_nodes(ctx, platforms), show_checks)


@cmd.command()
@nodes_argument()
@click.pass_context
def ready(ctx: click.Context, platforms: tuple[str, ...]) -> None:
    """Show whether vehicles may be armed, and the items that are not ready; without names for all vehicles.

    The exit code is 1 if no vehicle is ready, and 3 if some are not.

    Example: swarmctl health ready uav1
    """
    from swarmctl.commands.health.readiness import show_readiness
    from swarmctl.session.session import run

    run(at_nodes(ctx, platforms), show_readiness)


@cmd.command()
@click.option("--cleared", is_flag=True, help="Also cleared faults.")
@click.pass_context
def faults(ctx: click.Context, cleared: bool) -> None:
    """List the faults of platforms, newest first.

    Example: swarmctl health faults --node 'uav*' --cleared
    """
    from swarmctl.commands.health.report import list_faults
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), list_faults, cleared)


@cmd.command()
@click.argument("pattern", default="**")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def clear(ctx: click.Context, pattern: str, yes: bool) -> None:
    """Clear the faults of platforms whose check matches; remove ended applications and lost platforms.

    A check that still fails makes a new fault.

    Example: swarmctl health clear 'age/sensor/**' --node uav1
    """
    from swarmctl.commands.health.report import clear_faults
    from swarmctl.session.each_node import run_each
    from swarmware.model.names import Pattern

    Pattern(pattern)  # an invalid one is refused before the node is joined
    run_each(settings(ctx), clear_faults, pattern, yes=yes)
