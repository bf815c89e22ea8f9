"""Values of the options of every command: plain data, so that `--help` imports little."""

import os
from pathlib import Path
from typing import Final, NamedTuple

import click

PREFIX: Final = "SWARMCTL"
"""Every option is also read from the environment: SWARMCTL_…"""


class CliSettings(NamedTuple):
    """Options of `swarmctl` itself; accepted before or after the command's name."""

    node: str = ""
    """Platform of the session; empty: that of the joined node."""
    lab: str = ""
    """Running lab whose ground station is joined; empty: the newest."""
    config: str = ""
    """Configuration folder of the node to join, from `--config`."""
    json: bool = False
    timeout_s: float = 5.0
    quiet: bool = False
    verbose: bool = False
    no_color: bool = False

    @property
    def config_dir(self) -> Path | None:
        """The folder given by `--config` or, when no lab is given, by SWARM_CONFIG; else None."""
        from swarmware.model.config import CONFIG_VARIABLE

        given = self.config or ("" if self.lab else os.environ.get(CONFIG_VARIABLE, ""))
        return Path(given) if given else None


def settings(ctx: click.Context) -> CliSettings:
    """The settings of the command that is running."""
    found = ctx.obj
    return found if isinstance(found, CliSettings) else CliSettings()
