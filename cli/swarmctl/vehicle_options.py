"""Which vehicles a command is for, and how long it waits for them: options that commands share."""

from collections.abc import Callable
from typing import Any, Final

import click

from swarmctl import completion

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

EVERYTHING: Final = click.option("--all", "everything", is_flag=True, help="Every vehicle that is known.")
REASON: Final = click.option("--reason", default="operator", help="Why; it stands in every log.")
PLATFORMS: Final = click.argument(
    "platforms", nargs=-1, metavar="PLATFORM…", shell_complete=completion.platforms
)


def timeout_option(wait_s: float) -> Decorator:
    """How long the command waits, `wait_s` unless it is said."""
    return click.option(
        "--timeout",
        "wait_s",
        metavar="SECONDS",
        type=click.FloatRange(min=0, min_open=True),
        default=wait_s,
        help=f"Longest wait until it is seen to be done; default: {wait_s:g}.",
    )
