"""Options and arguments that several groups of commands have, and their types."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from swarmctl.commandline import completion
from swarmctl.commandline.settings import CliSettings, settings

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


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


def nodes_argument(name: str = "[PLATFORM…]") -> Decorator:
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


root_option: Final = click.option(
    "--root",
    "root_dir",
    type=click.Path(file_okay=False, path_type=Path),
    envvar="SWARMCTL_ROOT",
    metavar="DIR",
    help="Folder of the swarm's root key; by default ~/.local/share/swarmware/root.",
)

hosts_option: Final = click.option(
    "--hosts",
    "hosts_file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="HOSTS.toml",
    help="File of `swarmctl fleet` to change as well.",
)

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
