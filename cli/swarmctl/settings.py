"""What the options say that every command has; plain data, so that `--help` imports next to nothing."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import click

PREFIX: Final = "SWARMCTL"
"""Every option is also read from the environment: SWARMCTL_…"""


class Settings(NamedTuple):
    """Options of `swarmctl` itself; accepted before or after the command's name."""

    node: str = ""
    """Platform to ask about; empty: the node itself."""
    lab: str = ""
    """Running lab whose ground station is the way in; empty: the newest."""
    config: str = ""
    """Configuration folder of the node that is the way in, as `--config` gives it."""
    json: bool = False
    timeout_s: float = 5.0
    quiet: bool = False
    verbose: bool = False
    no_color: bool = False

    @property
    def config_dir(self) -> Path | None:
        """The folder that was given, by `--config` or, where no lab is named, by SWARM_CONFIG; else None."""
        from swarmware.config import CONFIG_VARIABLE

        given = self.config or ("" if self.lab else os.environ.get(CONFIG_VARIABLE, ""))
        return Path(given) if given else None


def settings(ctx: click.Context) -> Settings:
    """The settings of the command that is running."""
    found = ctx.obj
    return found if isinstance(found, Settings) else Settings()


def _keep(ctx: click.Context, param: click.Parameter, value: Any) -> None:
    """Writes an option that was given into the settings; another leaves them as they were.

    The environment counts at the top only: below it would go before an option given before the command.
    """
    source = ctx.get_parameter_source(param.name or "")
    given = {"COMMANDLINE", "ENVIRONMENT"} if ctx.parent is None else {"COMMANDLINE"}
    if source is not None and source.name in given:
        ctx.obj = settings(ctx)._replace(**{param.name or "": value})


def _option(*names: str, name: str, help_text: str, **rest: Any) -> Callable[[], click.Option]:
    variable = f"{PREFIX}_{name.removesuffix('_s').upper()}"

    def make() -> click.Option:
        return click.Option(
            [*names, name],
            help=help_text,
            **{"envvar": variable, **rest},
            expose_value=False,
            callback=_keep,
        )

    return make


def _platforms(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    from swarmctl import completing

    return completing.platforms(ctx, param, incomplete)


def _labs(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    from swarmctl import completing

    return completing.labs(ctx, param, incomplete)


_SHARED: Final = (
    _option(
        "--node",
        "-n",
        name="node",
        metavar="PLATFORM",
        help_text="Platform to ask about.",
        shell_complete=_platforms,
    ),
    _option(
        "--lab",
        name="lab",
        metavar="NAME",
        help_text="Running lab to use; default: the newest.",
        shell_complete=_labs,
    ),
    _option(
        "--config",
        name="config",
        metavar="DIR",
        help_text="Configuration folder of the node to use; default: SWARM_CONFIG, a lab, /etc/swarm.",
        envvar=None,  # the one variable of daemons and modules, too: see `Settings.config_dir`
        allow_from_autoenv=False,
    ),
    _option("--json", name="json", is_flag=True, help_text="Result as JSON."),
    _option(
        "--timeout",
        name="timeout_s",
        metavar="SECONDS",
        type=click.FloatRange(min=0, min_open=True),
        help_text="Longest wait for an answer; default: 5.",
    ),
    _option("--quiet", "-q", name="quiet", is_flag=True, help_text="No talk on stderr but errors."),
    _option("--verbose", "-v", name="verbose", is_flag=True, help_text="More talk on stderr."),
    _option("--no-color", name="no_color", is_flag=True, help_text="No colours; NO_COLOR does the same."),
)


def shared_options(taken: set[str]) -> list[click.Option]:
    """The options of every command, but for those whose spelling the command uses itself."""
    made = [make() for make in _SHARED]
    return [option for option in made if not taken & {option.name or "", *option.opts}]
