"""`swarmctl drive`: drive one vehicle by hand, with the keyboard."""

import click

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.parameters import PLATFORM
from swarmctl.commandline.settings import Nodes, settings

_SPEED = click.FloatRange(min=0, max=100, min_open=True)


@click.command(cls=Command, nodes=Nodes.NONE)
@click.argument("platform", type=PLATFORM)
@click.option("--take", is_flag=True, help="Take the stick from the operator who has it.")
@click.option("--speed", type=_SPEED, metavar="M_S", default=1.0, show_default=True, help="Speed of w a s d.")
@click.option("--climb", type=_SPEED, metavar="M_S", default=0.5, show_default=True, help="Speed of r f.")
@click.option("--turn", type=_SPEED, metavar="RAD_S", default=0.5, show_default=True, help="Rate of q e.")
@click.pass_context
def drive(ctx: click.Context, platform: str, take: bool, speed: float, climb: float, turn: float) -> None:
    """Drive a vehicle by hand: w s forward, back; a d left, right; q e turn; r f up, down; space stops.

    Its mission is held meanwhile. x or Ctrl-C releases the vehicle, which continues its mission, or holds.
    A key acts while it is held; without keys the vehicle stops, without link it holds after 0.3 s.

    Example: swarmctl drive uav1
    """
    from swarmctl.commands.drive.keyboard import Rates
    from swarmctl.commands.drive.stick import drive_by_hand
    from swarmctl.session.session import run
    from swarmware.model import names

    names.check_platform(platform)
    run(settings(ctx), drive_by_hand, platform, Rates(speed, climb, turn), take=take)
