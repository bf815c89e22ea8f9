"""`swarmctl doctor`: checks of this machine and its node, and of the placement of applications."""

import click

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.settings import settings


@click.command(cls=Command)
@click.argument("subject", type=click.Choice(["placement"]), required=False)
@click.option("--fix", is_flag=True, help="Remove files of dead processes.")
@click.option(
    "--link-mbit-s",
    type=click.FloatRange(min=0.001),
    metavar="MBIT/S",
    help="Rate of the links between the computers of a platform, for `placement`; default: as configured for"
    " the medium, or measured while it was the limit.",
)
@click.pass_context
def cmd(ctx: click.Context, subject: str | None, fix: bool, link_mbit_s: float | None) -> None:
    """Check this machine and its node, or the selected nodes, for problems.

    The exit code is 0 when healthy, 1 after warnings, 2 after errors. `placement` measures for three seconds
    what the computers of platforms receive from each other, and judges which applications may be separated.

    Example: swarmctl doctor --fix
    """
    from swarmctl.terminal.output import Output

    if subject is not None:
        from swarmctl.commands.doctor.placement import show_placement
        from swarmctl.session.session import run

        ctx.exit(run(settings(ctx), show_placement, link_mbit_s))
    from swarmctl.commands.doctor.diagnosis import diagnose

    ctx.exit(diagnose(Output(settings(ctx)), fix=fix))
