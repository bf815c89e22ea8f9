"""`swarmctl arm`, `disarm` and `kill`: control the motors of vehicles."""

import click

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.parameters import FORCE, PLATFORM, PLATFORMS, REASON, timeout_option
from swarmctl.commandline.settings import Nodes, settings

_WAIT_S = 10.0


@click.command(cls=Command)
@PLATFORMS
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation; motors may turn.")
@FORCE
@REASON
@timeout_option(_WAIT_S)
@click.pass_context
def arm(
    ctx: click.Context, platforms: tuple[str, ...], yes: bool, force: bool, reason: str, wait_s: float
) -> None:
    """Arm vehicles on the ground, after a confirmation that names them. Names may be patterns: 'uav*'.

    A vehicle that is not ready refuses with the reasons: see `swarmctl health ready`.

    Example: swarmctl arm uav1 --yes
    """
    from swarmctl.commands.motors import requests
    from swarmctl.session.session import run

    run(settings(ctx), requests.arm, platforms, wait_s, reason, yes=yes, force=force)


@click.command(cls=Command)
@PLATFORMS
@timeout_option(_WAIT_S)
@click.pass_context
def disarm(ctx: click.Context, platforms: tuple[str, ...], wait_s: float) -> None:
    """Disarm vehicles that are on the ground; a vehicle in the air refuses. Names may be patterns: 'uav*'.

    Example: swarmctl disarm --all
    """
    from swarmctl.commands.motors import requests
    from swarmctl.session.session import run

    run(settings(ctx), requests.disarm, platforms, wait_s)


@click.command(cls=Command, nodes=Nodes.NONE)
@click.argument("platform", type=PLATFORM)
@click.option(
    "--confirm", "again", metavar="PLATFORM", default="", help="The same name, instead of the prompt."
)
@REASON
@timeout_option(_WAIT_S)
@click.pass_context
def kill(ctx: click.Context, platform: str, again: str, reason: str, wait_s: float) -> None:
    """Stop the motors of one vehicle at once, also in the air: it falls. Its name must be given twice.

    It works without mission and navigator. There is no --yes and no pattern.

    Example: swarmctl kill uav1 --confirm uav1
    """
    from swarmctl.commands.motors import requests
    from swarmctl.session.session import run
    from swarmctl.terminal.confirmation import confirm_by_name
    from swarmware.model import names

    names.check_platform(platform)
    confirm_by_name(platform, again, f"kill {platform}: motors off, in the air it falls")
    run(settings(ctx), requests.kill, platform, reason, wait_s)
