"""`swarmctl wait`: wait until a condition holds."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.completion_cache import VALUED
from swarmctl.commandline.lazy import Command
from swarmctl.commandline.parameters import at_path


@click.command(cls=Command, context_settings={"ignore_unknown_options": True})
@click.argument("path", shell_complete=completion.resources(VALUED))
@click.argument(
    "condition",
    nargs=-1,
    required=True,
    metavar="CONDITION",
    shell_complete=completion.condition_words,
)
@click.option(
    "--timeout",
    "wait_s",
    type=click.FloatRange(min=0, min_open=True),
    default=30.0,
    metavar="SECONDS",
    help="Maximum wait, then exit code 4; default: 30.",
)
@click.pass_context
def wait(ctx: click.Context, path: str, condition: tuple[str, ...], wait_s: float) -> None:
    """Wait until a condition on the value of a resource holds, also of a resource that does not exist yet.

    CONDITION is a condition as in missions; a name without a slash is a field of the resource, and age() its
    age in seconds: 'z_m > 5 and age() < 1', 'state == "done"'. Several platforms must all reach it.

    Example: swarmctl wait /uav1/vehicle/state 'armed == true' --timeout 60
    """
    from swarmctl.commands.wait.waiting import wait_until
    from swarmctl.session.each_node import run_each

    chosen, local = at_path(ctx, path)
    run_each(chosen, wait_until, local, " ".join(condition), wait_s)
