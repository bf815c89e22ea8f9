"""`swarmctl new …`: a folder to begin with."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import Nodes, settings


@click.group(cls=Group)
def cmd() -> None:
    """Make a folder to begin with: sources, a test that passes, and a README.

    Example: swarmctl new module thermometer
    """


def _scaffold_arguments(function: Callable[..., Any]) -> Callable[..., Any]:
    """Argument and options of every kind."""
    folder = click.option(
        "--dir",
        "parent",
        type=click.Path(file_okay=False, path_type=Path),
        default=Path(),
        metavar="DIR",
        help="Folder in which the new one is made; default: the current one.",
    )
    return click.argument("name")(folder(function))


def _make(ctx: click.Context, kind: str, name: str, parent: Path) -> None:
    from swarmctl.commands.new.scaffold import make_scaffold
    from swarmctl.terminal.output import Output

    make_scaffold(kind, name, parent, Output(settings(ctx)))


@cmd.command(nodes=Nodes.NONE)
@_scaffold_arguments
@click.pass_context
def module(ctx: click.Context, name: str, parent: Path) -> None:
    """Make a functional module: an application that joins a node, with a board and a command.

    Example: swarmctl new module thermometer
    """
    _make(ctx, "module", name, parent)


@cmd.command(nodes=Nodes.NONE)
@_scaffold_arguments
@click.pass_context
def driver(ctx: click.Context, name: str, parent: Path) -> None:
    """Make a driver: a package whose device the daemon hal opens and reads.

    Example: swarmctl new driver sonar
    """
    _make(ctx, "driver", name, parent)


@cmd.command(nodes=Nodes.NONE)
@_scaffold_arguments
@click.pass_context
def service(ctx: click.Context, name: str, parent: Path) -> None:
    """Make a service: a module that the node supervises, with settings and a systemd unit.

    Example: swarmctl new service lookout
    """
    _make(ctx, "service", name, parent)


@cmd.command(nodes=Nodes.NONE)
@_scaffold_arguments
@click.pass_context
def block(ctx: click.Context, name: str, parent: Path) -> None:
    """Make a functional block for missions: parameters, plan, its test without a node, a mission with it.

    Example: swarmctl new block survey
    """
    _make(ctx, "block", name, parent)


@cmd.command(nodes=Nodes.NONE)
@_scaffold_arguments
@click.pass_context
def mission(ctx: click.Context, name: str, parent: Path) -> None:
    """Make a mission of two roles: mission.toml, a formation, a barrier, a condition.

    Example: swarmctl new mission relay
    """
    _make(ctx, "mission", name, parent)
