"""`swarmctl doctor`: look for what is wrong on this machine."""

import click

from swarmctl.lazy import Command
from swarmctl.settings import settings

WARNINGS = 1
ERRORS = 2


@click.command(cls=Command)
@click.option("--fix", is_flag=True, help="Remove what dead processes left.")
@click.pass_context
def cmd(ctx: click.Context, fix: bool) -> None:
    """Look for what is wrong on this machine and its node; exit code 0 healthy, 1 warnings, 2 errors.

    Example: swarmctl doctor --fix
    """
    from swarmctl.commands.doctor.checks import examine
    from swarmctl.output import Column, Output
    from swarmctl.session import local_config_dir
    from swarmware.errors import NotFound

    out = Output(settings(ctx))
    try:
        folder = local_config_dir(settings(ctx))
    except NotFound as error:
        if settings(ctx).node or settings(ctx).lab:
            raise  # what was named is not there
        out.say(f"{error}: only the machine is looked at")
        folder = None
    results = examine(folder, fix=fix)
    if settings(ctx).json:
        out.document({"results": results})
    else:
        rows = [(result.verdict, result.check, result.text, result.advice) for result in results]
        out.table([Column("VERDICT"), Column("CHECK"), Column("FOUND"), Column("ADVICE")], rows)
    verdicts = {result.verdict for result in results}
    ctx.exit(ERRORS if "error" in verdicts else WARNINGS if "warning" in verdicts else 0)
