"""Types of options and arguments that several commands have."""

from typing import Any, Final

import click

from swarmctl.commandline import completion


class GivenText(click.ParamType):  # type: ignore[type-arg]  # 8.1 is not generic
    """A text that must not be empty: `--lab "$LAB"` with an unset variable is refused."""

    name = "text"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The text itself; BadParameter for an empty one."""
        if value == "":
            self.fail("empty; expected a name, or leave it out", param, ctx)
        return value


class PlatformName(GivenText):
    """A platform, completed from the cache."""

    name = "platform"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Platforms that were listed before."""
        from click.shell_completion import CompletionItem

        return [CompletionItem(name) for name in completion.platforms(incomplete)]


TEXT: Final = GivenText()
PLATFORM: Final = PlatformName()
