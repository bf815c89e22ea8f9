"""Shared options of commands to vehicles: selection and time-out."""

from collections.abc import Callable
from typing import Any, Final

import click

from swarmctl.commandline.parameters import nodes_argument

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

REASON: Final = click.option("--reason", default="operator", help="Reason, recorded in all logs.")
FORCE: Final = click.option(
    "--force", is_flag=True, help="Arm although `health ready` names reasons; recorded with --reason."
)
PLATFORMS: Final = nodes_argument("PLATFORM…")


def timeout_option(wait_s: float) -> Decorator:
    """Option for the time-out of a command, with its default."""
    return click.option(
        "--timeout",
        "wait_s",
        metavar="SECONDS",
        type=click.FloatRange(min=0, min_open=True),
        default=wait_s,
        help=f"Maximum wait until all have done it; default: {wait_s:g}.",
    )
