"""`swarmctl doctor`: checks of this machine and its node."""

import click

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.settings import settings


@click.command(cls=Command)
@click.option("--fix", is_flag=True, help="Remove files of dead processes.")
@click.pass_context
def cmd(ctx: click.Context, fix: bool) -> None:
    """Check this machine and its node, or the selected nodes, for problems.

    The exit code is 0 when healthy, 1 after warnings, 2 after errors.

    Example: swarmctl doctor --fix
    """
    from swarmctl.commands.doctor.diagnosis import diagnose
    from swarmctl.terminal.output import Output

    ctx.exit(diagnose(Output(settings(ctx)), fix=fix))
