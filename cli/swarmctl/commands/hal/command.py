"""`swarmctl hal`: drivers of sensors and actuators."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM
from swarmctl.commandline.settings import Nodes, settings


@click.group(cls=Group)
def cmd() -> None:
    """Drivers of sensors and actuators, and the devices behind them.

    Example: swarmctl hal ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the drivers of platforms: state, asked and real rate, lateness, errors.

    Example: swarmctl hal ls --node uav1
    """
    from swarmctl.commands.hal.drivers import list_drivers
    from swarmctl.session.session import run

    run(settings(ctx), list_drivers)


@cmd.command(nodes=Nodes.NONE)
@click.argument("platform", type=PLATFORM)
@click.option(
    "--confirm", "again", metavar="PLATFORM", default="", help="The same name, instead of the prompt."
)
@click.pass_context
def calibrate(ctx: click.Context, platform: str, again: str) -> None:
    """Calibrate the motor controllers of one vehicle, disarmed and on the ground. Its name is given twice.

    Remove the propellers: the motors may turn at full throttle.

    Example: swarmctl hal calibrate uav1 --confirm uav1
    """
    from swarmctl.commands.hal.calibration import calibrate_motors
    from swarmctl.session.session import run
    from swarmctl.terminal.confirmation import confirm_by_name
    from swarmware.model import names

    names.check_platform(platform)
    confirm_by_name(platform, again, f"calibrate {platform}: its motors may turn at full throttle")
    run(settings(ctx), calibrate_motors, platform)
