"""Types of options and arguments that several commands have."""

from collections.abc import Callable
from typing import Any, Final

import click

from swarmctl.commandline import completion
from swarmctl.commandline.settings import CliSettings, settings


class GivenText(click.ParamType):  # type: ignore[type-arg]  # 8.1 is not generic
    """A text that must not be empty, so that `--lab "$LAB"` with an unset variable is refused."""

    name = "text"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The text itself. Raises: BadParameter for an empty text."""
        if value == "":
            self.fail("empty; expected a name, or leave it out", param, ctx)
        return value


class PlatformName(GivenText):
    """A platform, or a selection of some, completed from the cache."""

    name = "platform"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Platforms that were listed before, also after a comma."""
        from click.shell_completion import CompletionItem

        begun, comma, word = incomplete.rpartition(",")
        return [CompletionItem(f"{begun}{comma}{name}") for name in completion.platforms(word)]


TEXT: Final = GivenText()
PLATFORM: Final = PlatformName()


def nodes_argument(name: str = "[PLATFORM…]") -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Argument `platforms` of a command: nodes by name or pattern."""
    return click.argument("platforms", nargs=-1, metavar=name, type=PLATFORM)


def at_nodes(ctx: click.Context, platforms: tuple[str, ...]) -> CliSettings:
    """Settings with the nodes that the arguments name, or with the nodes of `-n` without arguments."""
    found = settings(ctx)
    return found._replace(node=",".join(platforms)) if platforms else found


def named_nodes(ctx: click.Context, platforms: tuple[str, ...]) -> CliSettings:
    """The settings with the nodes that arguments or options name.

    Raises: UsageError without a name, because the command must not fall back to the joined node.
    """
    found = at_nodes(ctx, platforms)
    if not found.node:
        raise click.UsageError("expected names of platforms, or --all", ctx)
    return found


def at_pattern(ctx: click.Context, pattern: str) -> tuple[CliSettings, str]:
    """Like `at_path`, where a platform alone, or an empty pattern, stands for all of its resources."""
    chosen, local = at_path(ctx, pattern.rstrip("/"))
    if local.startswith("/"):
        return chosen._replace(node=local[1:]), "**"
    return chosen, local or "**"


def at_path(ctx: click.Context, path: str) -> tuple[CliSettings, str]:
    """The settings with the nodes of a path, which may be a pattern, and the path without them."""
    platform, _, local = path.removeprefix("/").partition("/")
    if not path.startswith("/") or not platform or not local:
        return settings(ctx), path
    return settings(ctx)._replace(node=platform), local
