"""A command group that imports a command only when it is called, which keeps `swarmctl --help` fast."""

import os
from collections.abc import Mapping
from functools import cached_property
from importlib import import_module
from typing import Any, Final, NamedTuple

import click

from swarmctl.commandline.settings import Nodes, settings
from swarmctl.commandline.shared_options import shared_options
from swarmware.footprint.event_loop import import_without_tls

SENTENCE: Final = 500
"""Maximum characters of the first sentence of a help text."""
EXTERNAL: Final = "swarmctl-"
"""Prefix of programs on PATH that are commands as well, as in git."""


class Lazy(NamedTuple):
    """Module of a command, and its line in the list of commands."""

    target: str
    """`package.module:attribute`."""
    summary: str


class Command(click.Command):
    """A command that also accepts the shared options."""

    def __init__(self, *args: Any, nodes: Nodes = Nodes.SOME, **kwargs: Any) -> None:
        self.nodes = nodes
        self._own: list[click.Parameter] = []
        super().__init__(*args, **kwargs)

    @property
    def params(self) -> list[click.Parameter]:
        """The command's own parameters and the shared options."""
        return self._all

    @params.setter
    def params(self, own: list[click.Parameter]) -> None:
        self._own = own

    @cached_property
    def shared(self) -> list[click.Option]:
        """The shared options, made at the first use, because only one command of a group is called."""
        return shared_options({name for p in self._own for name in (p.name or "", *p.opts)}, self.nodes)

    @cached_property
    def _all(self) -> list[click.Parameter]:
        """All parameters, always the same list, because click temporarily adds its help option to it."""
        return [*self._own, *self.shared]

    def invoke(self, ctx: click.Context) -> Any:
        """Runs the command.

        Raises: UsageError when several nodes are selected for a command that acts through one node.
        """
        selected = settings(ctx).node
        if self.nodes is Nodes.ONE and any(char in selected for char in "*{,"):
            raise click.UsageError(
                f"--node {selected!r}: this command acts through one node; expected its name", ctx
            )
        if self.nodes is not Nodes.NONE:
            # without `ssl`, which no command uses and whose import would delay each of them
            import_without_tls("asyncio")
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Prints the arguments, then the command's own options, then the shared ones."""
        from swarmctl.commandline.arguments import meaning

        params = self.get_params(ctx)
        arguments: list[tuple[str, str] | None] = [
            (param.human_readable_name, meaning(ctx.command_path, param.name or ""))
            for param in params
            if isinstance(param, click.Argument)
        ]
        own = [
            param.get_help_record(ctx)
            for param in params
            if param not in self.shared and not isinstance(param, click.Argument)
        ]
        shared = [param.get_help_record(ctx) for param in self.shared]
        parts = (("Arguments", arguments), ("Options", own), ("Options of every command", shared))
        for title, records in parts:
            if rows := [record for record in records if record is not None]:
                with formatter.section(title):
                    formatter.write_dl(rows)


class Group(click.Group):
    """A group of commands that accept the shared options."""

    command_class = Command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Prints the subcommands with their complete first sentences, wrapped to the terminal."""
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, one.get_short_help_str(SENTENCE)) for name, one in commands if one])


Group.group_class = Group


class LazyGroup(Group):
    """The top group: commands in titled sections, imported at a call, and programs on PATH."""

    def __init__(self, *args: Any, sections: Mapping[str, Mapping[str, Lazy]], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._sections = sections

    @property
    def _table(self) -> dict[str, Lazy]:
        """The commands of all sections."""
        return {name: lazy for section in self._sections.values() for name, lazy in section.items()}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the sections instead of the alphabet."""
        return list(self._table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Imports and returns the command."""
        lazy = self._table.get(cmd_name)
        if lazy is None:
            return external(cmd_name)
        module, _, attribute = lazy.target.partition(":")
        found = getattr(import_module(module), attribute)
        if not isinstance(found, click.Command):
            raise TypeError(f"{module}:{attribute} is not a click command")
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the words name. Raises: UsageError with the closest match to an unknown name."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            from difflib import get_close_matches

            if near := get_close_matches(args[0], self.list_commands(ctx), n=1):
                raise click.UsageError(f"no command {args[0]!r}; did you mean {near[0]!r}?", ctx) from error
            raise

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """Names with this prefix, from the table alone."""
        from click.shell_completion import CompletionItem

        found = [
            CompletionItem(name, help=lazy.summary)
            for name, lazy in self._table.items()
            if name.startswith(incomplete)
        ]
        return found + click.Command.shell_complete(self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Prints the sections of commands from the table alone, so that nothing is imported."""
        width = max(map(len, self._table))
        for title, section in self._sections.items():
            with formatter.section(title):
                # names of equal width, so that the summaries of all sections begin in one column
                formatter.write_dl([(name.ljust(width), lazy.summary) for name, lazy in section.items()])
        if others := externals(os.environ.get("PATH", "")):
            with formatter.section("Programs on PATH"):
                formatter.write_dl([(name, f"{EXTERNAL}{name}") for name in others])


def external(name: str) -> click.Command | None:
    """The command that executes the program `swarmctl-NAME` on PATH."""
    from shutil import which  # not at the top, because it imports the modules of all archive formats

    program = which(EXTERNAL + name) if "/" not in name else None
    if program is None:
        return None

    def hand_over() -> None:
        os.execv(program, [program, *click.get_current_context().args])

    return click.Command(
        name,
        callback=hand_over,
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )


def externals(path: str) -> list[str]:
    """Names of the programs `swarmctl-*` in the directories of PATH."""
    found: set[str] = set()
    for directory in filter(None, path.split(os.pathsep)):
        try:
            entries = [entry for entry in os.scandir(directory) if entry.name.startswith(EXTERNAL)]
        except OSError:  # a missing folder of PATH is skipped, as in a shell
            continue
        found.update(e.name.removeprefix(EXTERNAL) for e in entries if os.access(e.path, os.X_OK))
    return sorted(found)
