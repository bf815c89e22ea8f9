"""`swarmctl hold`, `land` and `return`: start built-in missions of vehicles."""

from collections.abc import Callable
from typing import Any

import click

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.settings import settings
from swarmctl.vehicles.options import PLATFORMS, REASON, Decorator, timeout_option


def _options(wait_s: float) -> Decorator:
    """Options of all these commands."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        for decorator in (PLATFORMS, REASON, timeout_option(wait_s), click.pass_context):
            function = decorator(function)
        return function

    return decorate


def _run(ctx: click.Context, then: str, platforms: tuple[str, ...], reason: str, wait_s: float) -> None:
    from swarmctl.session.session import run
    from swarmctl.vehicles.manoeuvre import command

    run(settings(ctx), command, then, platforms, wait_s, reason)


@click.command(cls=Command)
@_options(15.0)
def hold(ctx: click.Context, **options: Any) -> None:
    """Stop vehicles and hold their positions; this ends their missions. Names may be patterns: 'uav*'.

    Example: swarmctl hold uav1
    """
    _run(ctx, "hold", **options)


@click.command(cls=Command)
@_options(120.0)
def land(ctx: click.Context, **options: Any) -> None:
    """Land vehicles at their positions and disarm them; ground vehicles stop. This ends their missions.

    Example: swarmctl land --all
    """
    _run(ctx, "land", **options)


@click.command(cls=Command, name="return")
@_options(420.0)
def return_(ctx: click.Context, **options: Any) -> None:
    """Return vehicles to the place where they were armed, land and disarm them. This ends their missions.

    Example: swarmctl return uav1 uav2 --timeout 120
    """
    _run(ctx, "return", **options)
