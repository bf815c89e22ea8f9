"""The options that every command accepts, before or after its name; their values are in `CliSettings`."""

from collections.abc import Callable
from typing import Any, Final

import click

from swarmctl.commandline import completion
from swarmctl.commandline.parameters import PLATFORM, TEXT
from swarmctl.commandline.settings import FORMATS, PREFIX, Nodes, settings

_NODES: Final = "swarmctl.nodes"
"""Key in the context's data for the command and the option that selected the nodes last."""


def _keep(ctx: click.Context, param: click.Parameter, value: Any) -> None:
    """Stores the value of a given option in the settings.

    The environment is read at the top only: at a command it would override an option given before it.
    """
    source = ctx.get_parameter_source(param.name or "")
    given = {"COMMANDLINE", "ENVIRONMENT"} if ctx.parent is None else {"COMMANDLINE"}
    if source is not None and source.name in given:
        if param.name == "json":
            if value:
                ctx.obj = settings(ctx)._replace(output="json")
            return
        if param.name in {"node", "everywhere"}:
            _keep_nodes(ctx, param.name, value, typed=source.name == "COMMANDLINE")
            return
        ctx.obj = settings(ctx)._replace(**{param.name or "": value})


def _keep_nodes(ctx: click.Context, name: str, value: Any, *, typed: bool) -> None:
    """Stores the selection of `--node` or `--all`; the environment does not replace a typed selection.

    Raises: UsageError when both are typed at one command.
    """
    if not value:
        return
    before = ctx.meta.get(_NODES)
    if before is not None and before[0] is ctx and before[1] != name:
        if typed:
            raise click.UsageError("--node and --all: expected one of them", ctx)
        return
    if typed:
        ctx.meta[_NODES] = (ctx, name)
    ctx.obj = settings(ctx)._replace(node="*" if name == "everywhere" else ",".join(value))


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


_SHARED: Final = (
    _option(
        "--node",
        "-n",
        name="node",
        metavar="PLATFORM",
        help_text="Platforms to query or command: names or patterns (uav1,ugv1 'uav*' 'uav{1,3}'); several -n"
        " add up.",
        type=PLATFORM,
        multiple=True,
    ),
    _option(
        "--all",
        name="everywhere",
        is_flag=True,
        help_text="All platforms, same as -n '*'; for a command to vehicles, all vehicles.",
        envvar=None,  # a variable that is forgotten must not address the whole swarm
        allow_from_autoenv=False,
    ),
    _option(
        "--lab",
        name="lab",
        metavar="NAME",
        help_text="Running lab to use; by default the newest.",
        type=TEXT,
        shell_complete=completion.labs,
    ),
    _option(
        "--config",
        name="config",
        metavar="DIR",
        type=TEXT,
        help_text="Configuration folder of the node to use; by default SWARM_CONFIG, a lab or /etc/swarm.",
        envvar=None,  # the one variable of daemons and modules, too: see `Settings.config_dir`
        allow_from_autoenv=False,
    ),
    _option(
        "--output",
        "-o",
        name="output",
        type=click.Choice(FORMATS),
        metavar="FORMAT",
        help_text=f"Form of the result: {', '.join(FORMATS)}; default: table.",
    ),
    _option("--json", name="json", is_flag=True, help_text="Same as -o json."),
    _option(
        "--timeout",
        name="timeout_s",
        metavar="SECONDS",
        type=click.FloatRange(min=0, min_open=True),
        help_text="Maximum wait for an answer; default: 5.",
    ),
    _option("--quiet", "-q", name="quiet", is_flag=True, help_text="Only warnings and errors on stderr."),
    _option("--verbose", "-v", name="verbose", is_flag=True, help_text="More messages on stderr."),
    _option("--no-color", name="no_color", is_flag=True, help_text="No colours; NO_COLOR does the same."),
)


def shared_options(taken: set[str], nodes: Nodes = Nodes.SOME) -> list[click.Option]:
    """The options of every command, except options that the command defines itself.

    `nodes`: which of the options that select nodes it accepts.
    """
    without = {Nodes.SOME: set(), Nodes.ONE: {"everywhere"}, Nodes.NONE: {"node", "everywhere"}}[nodes]
    made = [make() for make in _SHARED]
    return [
        option
        for option in made
        if option.name not in without and not taken & {option.name or "", *option.opts}
    ]
