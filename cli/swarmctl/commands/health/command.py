"""`swarmctl health`: state and faults of the nodes."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM
from swarmctl.commandline.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """State and faults of the nodes.

    Example: swarmctl health ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """Show the state of every platform, or of one: level, battery, applications, guard, confirmed faults.

    Example: swarmctl health ls
    """
    from swarmctl.commands.health.report import list_states
    from swarmctl.session.session import run

    run(settings(ctx), list_states)


@cmd.command()
@click.argument("platform", required=False, type=PLATFORM)
@click.pass_context
def info(ctx: click.Context, platform: str | None) -> None:
    """Show each check of a platform and its present result.

    Example: swarmctl health info uav1
    """
    from swarmctl.commands.health.report import show_checks
    from swarmctl.session.session import run

    run(settings(ctx), show_checks, platform or "")


@cmd.command()
@click.option("--cleared", is_flag=True, help="Also cleared faults.")
@click.pass_context
def faults(ctx: click.Context, cleared: bool) -> None:
    """List the faults of a platform, newest first.

    Example: swarmctl health faults --node uav1 --cleared
    """
    from swarmctl.commands.health.report import list_faults
    from swarmctl.session.session import run

    run(settings(ctx), list_faults, cleared)


@cmd.command()
@click.argument("pattern", default="**")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def clear(ctx: click.Context, pattern: str, yes: bool) -> None:
    """Clear the faults of a platform whose check matches; forget ended applications and lost platforms.

    A check that still fails makes a new fault.

    Example: swarmctl health clear 'age/sensor/**' --node uav1
    """
    from swarmctl.commands.health.report import clear_faults
    from swarmctl.session.session import run
    from swarmctl.terminal.confirmation import confirm
    from swarmware.model.names import Pattern

    Pattern(pattern)  # an invalid one is refused before the confirmation
    confirm(yes, f"clear the faults that match {pattern}")
    run(settings(ctx), clear_faults, pattern)
