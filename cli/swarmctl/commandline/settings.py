"""Values of the options of every command: plain data, so that `--help` imports little."""

import os
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import TYPE_CHECKING, Final, NamedTuple

import click

if TYPE_CHECKING:
    from pathlib import Path

PREFIX: Final = "SWARMCTL"
"""Prefix of the environment variables from which every option is also read."""


FORMATS: Final = ("table", "wide", "json", "jsonl", "yaml")
"""Forms of a result; `wide` is the table with all its columns."""
STRUCTURED: Final = frozenset({"json", "jsonl", "yaml"})


class Nodes(Enum):
    """Nodes that a command acts on."""

    SOME = "some"
    """Each selected node, or the joined node without a selection."""
    ONE = "one"
    """Exactly one node, by the nature of the command."""
    NONE = "none"
    """No node of a running swarm."""


class CliSettings(NamedTuple):
    """Options of `swarmctl` itself; accepted before or after the command's name."""

    node: str = ""
    """Selected platforms, as in `commandline/nodes.py`, or "" for the platform of the joined node."""
    lab: str = ""
    """Running lab whose ground station is joined, or "" for the newest."""
    config: str = ""
    """Configuration folder of the node to join, from `--config`."""
    output: str = "table"
    """Form of the result, one of FORMATS."""
    timeout_s: float = 5.0
    quiet: bool = False
    verbose: bool = False
    no_color: bool = False

    @property
    def structured(self) -> bool:
        """Whether the result is for programs: JSON or YAML, not a table."""
        return self.output in STRUCTURED

    @property
    def config_dir(self) -> "Path | None":
        """Folder of `--config` or, without `--lab`, of SWARM_CONFIG; it is None without either."""
        from pathlib import Path  # it imports the modules of addresses

        from swarmware.model.config import CONFIG_VARIABLE

        given = self.config or ("" if self.lab else os.environ.get(CONFIG_VARIABLE, ""))
        return Path(given) if given else None


def wants_structured(words: Sequence[str], environ: Mapping[str, str]) -> bool:
    """Whether a command line, even an invalid one, asks for a structured result."""
    found = environ.get(f"{PREFIX}_OUTPUT", "")
    if environ.get(f"{PREFIX}_JSON", "").lower() in {"1", "true", "t", "yes", "y", "on"}:
        found = "json"
    for word, following in zip(words, [*words[1:], ""], strict=True):
        if word == "--":
            break  # what follows are arguments, although they may look like options
        if word == "--json":
            found = "json"
        elif word in {"-o", "--output"}:
            found = following
        elif word.startswith(("-o", "--output=")):
            found = word.removeprefix("--output=").removeprefix("-o")
    return found in STRUCTURED


def settings(ctx: click.Context) -> CliSettings:
    """The settings of the command that is running."""
    found = ctx.obj
    return found if isinstance(found, CliSettings) else CliSettings()
