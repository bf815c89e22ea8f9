"""`swarmctl takeoff`, `goto`, `hold`, `land` and `return`: manoeuvres of vehicles."""

import math
from collections.abc import Callable
from typing import Any

import click

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.parameters import FORCE, PLATFORMS, REASON, Decorator, timeout_option
from swarmctl.commandline.settings import settings

_NEVER_ASKS = click.option(
    "--yes", is_flag=True, expose_value=False, help="Accepted as by takeoff; this command never asks."
)


def _options(wait_s: float, *decorators: Decorator) -> Decorator:
    """Options that all these commands share, and the given ones of a single command."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        given: tuple[Decorator, ...] = (
            PLATFORMS,
            REASON,
            timeout_option(wait_s),
            *decorators,
            click.pass_context,
        )
        for decorator in given:
            function = decorator(function)
        return function

    return decorate


def _run(ctx: click.Context, then: str, platforms: tuple[str, ...], reason: str, wait_s: float) -> None:
    from swarmctl.session.session import run
    from swarmctl.vehicles.manoeuvre import command

    run(settings(ctx), command, then, platforms, wait_s, reason)


@click.command(cls=Command)
@_options(15.0, _NEVER_ASKS)
def hold(ctx: click.Context, **options: Any) -> None:
    """Stop vehicles and hold their positions; this ends their missions. Names may be patterns: 'uav*'.

    Example: swarmctl hold uav1
    """
    _run(ctx, "hold", **options)


@click.command(cls=Command)
@_options(120.0, _NEVER_ASKS)
def land(ctx: click.Context, **options: Any) -> None:
    """Land vehicles at their positions and disarm them; ground vehicles stop. This ends their missions.

    Example: swarmctl land --all
    """
    _run(ctx, "land", **options)


@click.command(cls=Command, name="return")
@_options(420.0, _NEVER_ASKS)
def return_(ctx: click.Context, **options: Any) -> None:
    """Return vehicles to the place where they were armed, land and disarm them. This ends their missions.

    Example: swarmctl return uav1 uav2 --timeout 120
    """
    _run(ctx, "return", **options)


class Place(click.ParamType):  # type: ignore[type-arg]  # 8.1 is not generic
    """Coordinates `X,Y` or `X,Y,Z` in metres."""

    name = "place"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers; BadParameter for any other text."""
        if isinstance(value, tuple):
            return value
        try:
            found = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            found = ()
        if len(found) not in (2, 3) or not all(math.isfinite(part) for part in found):
            self.fail(f"{value!r}: expected X,Y or X,Y,Z in metres, such as 12.5,-3,5", param, ctx)
        return found


_SPEED = click.option(
    "--speed",
    "speed_m_s",
    type=click.FloatRange(min=0, max=50, min_open=True),
    metavar="M_S",
    default=1.5,
    show_default=True,
    help="Maximum speed.",
)


@click.command(cls=Command)
@click.option(
    "--altitude",
    "altitude_m",
    type=click.FloatRange(min=0.5, max=1000),
    metavar="M",
    default=5.0,
    show_default=True,
    help="Height above the origin of the map.",
)
@_SPEED
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation when several vehicles take off.")
@FORCE
@_options(60.0)
def takeoff(
    ctx: click.Context,
    platforms: tuple[str, ...],
    altitude_m: float,
    speed_m_s: float,
    yes: bool,
    force: bool,
    reason: str,
    wait_s: float,
) -> None:
    """Arm vehicles and let them climb to an altitude, where they hold. This ends their missions.

    Several vehicles take off after a confirmation that names them. Names may be patterns: 'uav*'.
    A vehicle that is not ready refuses with the reasons: see `swarmctl health ready`.

    Example: swarmctl takeoff uav1
    """
    from swarmctl.commands.manoeuvre.requests import take_off
    from swarmctl.session.session import run

    run(settings(ctx), take_off, platforms, altitude_m, speed_m_s, reason, wait_s, yes=yes, force=force)


@click.command(cls=Command)
@click.option("--to", type=Place(), metavar="X,Y[,Z]", help="Place in the map: east, north, up; one vehicle.")
@click.option(
    "--by", type=Place(), metavar="X,Y[,Z]", help="Displacement from the present place of each vehicle."
)
@_SPEED
@_options(300.0, _NEVER_ASKS)
def goto(
    ctx: click.Context,
    platforms: tuple[str, ...],
    to: tuple[float, ...] | None,
    by: tuple[float, ...] | None,
    speed_m_s: float,
    reason: str,
    wait_s: float,
) -> None:
    """Move vehicles to a place, where they hold. This ends their missions.

    Without a height each vehicle keeps its height. --by moves several vehicles.

    Example: swarmctl goto uav1 --to 10,-5,4
    """
    from swarmctl.commands.manoeuvre.requests import go_to
    from swarmctl.session.session import run

    if (to is None) == (by is None):
        raise click.UsageError("expected --to X,Y[,Z] or --by X,Y[,Z]")
    run(settings(ctx), go_to, platforms, to, by, speed_m_s, reason, wait_s)
