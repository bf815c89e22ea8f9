"""`swarmctl doctor`: look for what is wrong on this machine."""

import click

from swarmctl.lazy import Command
from swarmctl.settings import settings


@click.command(cls=Command)
@click.option("--fix", is_flag=True, help="Remove what dead processes left.")
@click.pass_context
def cmd(ctx: click.Context, fix: bool) -> None:
    """Look for what is wrong on this machine and its node; exit code 0 healthy, 1 warnings, 2 errors.

    Example: swarmctl doctor --fix
    """
    from swarmctl.commands.doctor.diagnosis import diagnose
    from swarmctl.output import Output

    ctx.exit(diagnose(Output(settings(ctx)), fix=fix))
