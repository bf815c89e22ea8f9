"""`swarmctl hal`: drivers of sensors and actuators."""

from typing import Final

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM
from swarmctl.commandline.settings import Nodes, settings

SENSORS: Final = ("gyro", "accelerometer", "level", "compass", "reset")
"""Parts of an inertial unit, and the removal of their corrections."""


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
@click.option(
    "--sensor", type=click.Choice(SENSORS), help="Calibrate this part of the inertial unit, not the motors."
)
@click.option(
    "--heading",
    "heading_deg",
    type=click.FloatRange(0, 360),
    metavar="DEG",
    help="True heading for --sensor compass: 0 is north, 90 is east.",
)
@click.option("--driver", default="", metavar="NAME", help="Driver of the inertial unit; default: the first.")
@click.pass_context
def calibrate(
    ctx: click.Context,
    platform: str,
    again: str,
    sensor: str | None,
    heading_deg: float | None,
    driver: str,
) -> None:
    """Calibrate the motor controllers or the inertial unit of one vehicle, disarmed and on the ground.

    For motors its name is given twice; remove the propellers: they may turn at full throttle. With --sensor
    the vehicle must be at rest for five seconds: gyro, accelerometer (once in each of six attitudes), level,
    compass, or reset, which removes the corrections.

    Example: swarmctl hal calibrate uav1 --sensor gyro
    """
    from swarmctl.commands.hal.calibration import calibrate_motors, calibrate_sensor
    from swarmctl.session.session import run
    from swarmctl.terminal.confirmation import confirm_by_name
    from swarmware.model import names

    names.check_platform(platform)
    if sensor is not None:
        if (sensor == "compass") != (heading_deg is not None):
            raise click.UsageError("--heading: expected with --sensor compass, and only there")
        run(settings(ctx), calibrate_sensor, platform, sensor, heading_deg, driver)
        return
    confirm_by_name(platform, again, f"calibrate {platform}: its motors may turn at full throttle")
    run(settings(ctx), calibrate_motors, platform)
