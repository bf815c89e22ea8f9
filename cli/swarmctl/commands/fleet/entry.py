"""What the commands of `fleet` call: reads the file, asks for a confirmation, and runs at all hosts."""

import asyncio
from pathlib import Path

from swarmctl.commandline.nodes import joined
from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.fleet.executing import execute as execute_at
from swarmctl.commands.fleet.listing import list_hosts
from swarmctl.commands.fleet.plan import FleetGoal
from swarmctl.commands.fleet.remote import read_wheel
from swarmctl.commands.fleet.running import bring
from swarmctl.membership.hosts import FleetHost, choose, read_hosts
from swarmctl.terminal.confirmation import confirm


def hosts_of(path: Path, selected: tuple[str, ...]) -> list[FleetHost]:
    """The selected hosts of a file.

    Raises: as `read_hosts` and `choose`.
    """
    return choose(read_hosts(path), joined(selected), path)


def ls(settings: CliSettings, path: Path, selected: tuple[str, ...]) -> None:
    """Lists the hosts of a file."""
    asyncio.run(list_hosts(settings, hosts_of(path, selected)))


def push(
    settings: CliSettings, path: Path, selected: tuple[str, ...], wheel: Path | None, parallel: int
) -> None:
    """Brings files and a wheel to hosts."""
    hosts = hosts_of(path, selected)
    software = read_wheel(wheel) if wheel is not None else None
    asyncio.run(bring(settings, hosts, FleetGoal.PUSH, wheel=software, parallel=parallel))


def up(
    settings: CliSettings,
    path: Path,
    selected: tuple[str, ...],
    parallel: int,
    wait_s: float,
    *,
    sync: bool,
) -> None:
    """Starts the nodes of hosts."""
    hosts = hosts_of(path, selected)
    asyncio.run(bring(settings, hosts, FleetGoal.UP, parallel=parallel, wait_s=wait_s, sync=sync))


def down(
    settings: CliSettings,
    path: Path,
    selected: tuple[str, ...],
    parallel: int,
    wait_s: float,
    *,
    yes: bool,
    force: bool,
) -> None:
    """Stops the nodes of hosts."""
    hosts = hosts_of(path, selected)
    armed = ", also armed vehicles" if force else ""
    confirm(yes, f"stop the nodes of {', '.join(host.name for host in hosts)}{armed}")
    asyncio.run(bring(settings, hosts, FleetGoal.DOWN, parallel=parallel, wait_s=wait_s, force=force))


def upgrade(  # noqa: PLR0913 - an argument for each option
    settings: CliSettings,
    path: Path,
    selected: tuple[str, ...],
    *,
    wheel: Path,
    parallel: int,
    keep_going: bool,
    yes: bool,
    force: bool,
    no_sync: bool,
    wait_s: float,
) -> None:
    """Installs another wheel on hosts and restarts their nodes."""
    hosts = hosts_of(path, selected)
    # before the confirmation and the first host: a wrong file changes nothing
    software = read_wheel(wheel)
    armed = ", also armed vehicles" if force else ""
    names = ", ".join(host.name for host in hosts)
    confirm(yes, f"upgrade {names} to {wheel.name}: nodes that run are stopped meanwhile{armed}")
    asyncio.run(
        bring(
            settings,
            hosts,
            FleetGoal.UPGRADE,
            wheel=software,
            parallel=parallel,
            wait_s=wait_s,
            force=force,
            sync=not no_sync,
            stops=not keep_going,
        )
    )


def execute(
    settings: CliSettings, path: Path, selected: tuple[str, ...], words: tuple[str, ...], parallel: int
) -> None:
    """Runs a command on hosts."""
    asyncio.run(execute_at(settings, hosts_of(path, selected), words, parallel))
