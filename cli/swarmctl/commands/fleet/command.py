"""`swarmctl fleet`: nodes on other hosts, over SSH."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import timeout_option
from swarmctl.commandline.settings import Nodes, settings

PARALLEL: Final = 16


@click.group(cls=Group)
def cmd() -> None:
    """Install, start and stop nodes on other hosts over SSH; HOSTS.toml names the hosts.

    Each command can be repeated after an interruption, and then does the remaining steps.

    Example: swarmctl fleet up HOSTS.toml
    """


class HostName(click.ParamType):  # type: ignore[type-arg]  # 8.1 is not generic
    """Names or patterns of hosts, completed from the file of the command."""

    name = "host"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Names in the file, also after a comma."""
        from click.shell_completion import CompletionItem

        from swarmctl.membership.hosts import host_names

        begun, comma, word = incomplete.rpartition(",")
        found = host_names(str(ctx.params.get("hosts_file") or ""), word)
        return [CompletionItem(f"{begun}{comma}{name}") for name in found]


def _file(function: Callable[..., Any]) -> Callable[..., Any]:
    """The argument HOSTS.toml, and the option that selects hosts of it."""
    selected = click.option(
        "--host",
        "-H",
        "selected",
        type=HostName(),
        multiple=True,
        metavar="HOST",
        help="Hosts by name or pattern (uav1,ugv1 'uav*'); several -H add up; by default all.",
    )
    path = click.Path(path_type=Path)
    return click.argument("hosts_file", metavar="HOSTS.toml", type=path)(selected(function))


def _parallel(default: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    return click.option(
        "--parallel",
        type=click.IntRange(1, 256),
        default=default,
        show_default=True,
        metavar="N",
        help="Maximum number of hosts at the same time.",
    )


_force = click.option("--force", is_flag=True, help="Include armed vehicles and nodes that do not answer.")
_yes = click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
_sync = click.option("--no-sync", is_flag=True, help="Do not wait until the data are synchronised.")


@cmd.command(nodes=Nodes.NONE)
@_file
@click.pass_context
def ls(ctx: click.Context, hosts_file: Path, selected: tuple[str, ...]) -> None:
    """List the hosts with their reachability, version, state, start, configuration and synchronisation.

    Example: swarmctl fleet ls HOSTS.toml
    """
    from swarmctl.commands.fleet import entry

    entry.ls(settings(ctx), hosts_file, selected)


@cmd.command(nodes=Nodes.NONE)
@_file
@click.option("--wheel", type=click.Path(path_type=Path), metavar="FILE", help="Wheel to install as well.")
@_parallel(PARALLEL)
@click.pass_context
def push(
    ctx: click.Context, hosts_file: Path, selected: tuple[str, ...], wheel: Path | None, parallel: int
) -> None:
    """Copy configuration and missions, and with --wheel the software, to the hosts.

    The files are checked on the host; then all are replaced, or none. A running node reads them at its
    next start.

    Example: swarmctl fleet push HOSTS.toml --wheel dist/swarmware-0.1.0-py3-none-any.whl
    """
    from swarmctl.commands.fleet import entry

    entry.push(settings(ctx), hosts_file, selected, wheel, parallel)


@cmd.command(nodes=Nodes.NONE)
@_file
@_parallel(PARALLEL)
@_sync
@timeout_option(60.0)
@click.pass_context
def up(
    ctx: click.Context,
    hosts_file: Path,
    selected: tuple[str, ...],
    parallel: int,
    no_sync: bool,
    wait_s: float,
) -> None:
    """Start the nodes; wait until each answers and its data are synchronised with the node of this machine.

    Example: swarmctl fleet up HOSTS.toml
    """
    from swarmctl.commands.fleet import entry

    entry.up(settings(ctx), hosts_file, selected, parallel, wait_s, sync=not no_sync)


@cmd.command(nodes=Nodes.NONE)
@_file
@_parallel(PARALLEL)
@_yes
@_force
@timeout_option(30.0)
@click.pass_context
def down(
    ctx: click.Context,
    hosts_file: Path,
    selected: tuple[str, ...],
    parallel: int,
    yes: bool,
    force: bool,
    wait_s: float,
) -> None:
    """Stop the nodes. An armed vehicle is refused, unless --force is given.

    Example: swarmctl fleet down HOSTS.toml -H 'uav*' --yes
    """
    from swarmctl.commands.fleet import entry

    entry.down(settings(ctx), hosts_file, selected, parallel, wait_s, yes=yes, force=force)


@cmd.command(nodes=Nodes.NONE)
@_file
@click.option(
    "--wheel", type=click.Path(path_type=Path), required=True, metavar="FILE", help="Wheel to install."
)
@_parallel(1)
@click.option("--keep-going", is_flag=True, help="Continue with the next host when one fails.")
@_yes
@_force
@_sync
@timeout_option(60.0)
@click.pass_context
def upgrade(ctx: click.Context, /, hosts_file: Path, selected: tuple[str, ...], **options: Any) -> None:
    """Install another wheel, one host after the other: stop the node, install, start the node if it ran.

    The command stops at the first host whose node does not run again.

    Example: swarmctl fleet upgrade HOSTS.toml --wheel dist/swarmware-0.2.0-py3-none-any.whl --yes
    """
    from swarmctl.commands.fleet import entry

    entry.upgrade(settings(ctx), hosts_file, selected, **options)


@cmd.command(name="exec", nodes=Nodes.NONE)
@_file
@click.argument("words", nargs=-1, required=True, metavar="COMMAND…")
@_parallel(PARALLEL)
@click.pass_context
def exec_(
    ctx: click.Context, hosts_file: Path, selected: tuple[str, ...], words: tuple[str, ...], parallel: int
) -> None:
    """Run a command on the hosts and print its output, each line with the host.

    The exit code is 0 if the command succeeded on all hosts, and 3 if it failed on some.

    Example: swarmctl fleet exec HOSTS.toml -- df -h /var/lib/swarm
    """
    from swarmctl.commands.fleet import entry

    entry.execute(settings(ctx), hosts_file, selected, words, parallel)
