"""`swarmd`: runs daemons of a node."""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Final

from swarmware import __version__
from swarmware.errors import SwarmError

FAILED_S: Final = 2.0
"""Minimum lifetime of a process under systemd, which would restart a faster failure without limit."""


def parser() -> argparse.ArgumentParser:
    """The parser of swarmd's command line."""
    made = argparse.ArgumentParser(
        prog="swarmd",
        description="Run daemons of a Swarmware node.",
        epilog="Example: swarmd run broker tree register --config /etc/swarm",
    )
    made.add_argument("--version", action="version", version=f"swarmd {__version__}")
    commands = made.add_subparsers(dest="command", required=True, metavar="COMMAND")
    run = commands.add_parser(
        "run",
        help="run one service, or several in one process",
        epilog="Example: swarmd run broker tree register",
    )
    run.add_argument("services", nargs="+", metavar="NAME", help="a service; `swarmd ls` names them")
    node = commands.add_parser(
        "node", help="run all services of the node that node.toml lists", epilog="Example: swarmd node"
    )
    units = commands.add_parser(
        "units",
        help="list the systemd units of the services that node.toml lists",
        epilog="Example: systemctl enable swarm.target $(swarmd units)",
    )
    forks = commands.add_parser("forkserver")  # started by `swarmd node`: no help, so not listed
    forks.add_argument("services", nargs="*")
    for command in (run, node, units, forks):
        command.add_argument(
            "--config",
            metavar="DIR",
            type=Path,
            help="configuration folder with node.toml; default: SWARM_CONFIG, else /etc/swarm",
        )
    commands.add_parser("ls", help="list the services that are installed", epilog="Example: swarmd ls")
    return made


def main(args: list[str] | None = None) -> int:
    """Runs one command; an error that the user can cause gives one line and an exit code."""
    options = parser().parse_args(args)
    began_s = time.monotonic()
    failed = True
    try:
        code = _carry_out(options)
        failed = code != 0
        return code
    finally:
        # systemd starts it again at once, and without limit
        if failed and os.environ.get("SYSTEMD_EXEC_PID") == str(os.getpid()):
            time.sleep(max(0.0, began_s + FAILED_S - time.monotonic()))


def _carry_out(options: argparse.Namespace) -> int:
    try:
        match options.command:
            case "ls":
                return _list()
            case "units":
                return _units(_folder(options.config))
            case "node":
                return _node(_folder(options.config))
            case "forkserver":
                return _forks(_folder(options.config), options.services)
            case _:
                return _run(_folder(options.config), options.services)
    except SwarmError as error:
        sys.stderr.write(f"swarmd: {error}\n")
        return error.exit_code


def _folder(given: Path | None) -> Path:
    from swarmware.model.config import find_config_dir

    return find_config_dir(given)


def _list() -> int:
    from swarmware.service.installed import installed

    for name, point in installed().items():
        sys.stdout.write(f"{name:<12} {point.value}\n")
    return 0


def _units(config_dir: Path) -> int:
    from swarmware.model.config import load_node

    for name in load_node(config_dir).services:
        sys.stdout.write(f"swarmd@{name}.service\n")
    return 0


def _import_event_loop() -> None:
    from swarmware.model.plugins import none_is_foreign
    from swarmware.runtime.event_loop import import_without_tls

    if none_is_foreign():
        import_without_tls()


def _run(config_dir: Path, names: list[str]) -> int:
    _import_event_loop()
    from swarmware.service.runner import run_services

    return run_services(config_dir, list(dict.fromkeys(names)))


def _forks(config_dir: Path, names: list[str]) -> int:
    _import_event_loop()
    from swarmd.forkserver import ForkServer, preload
    from swarmware.model.config import load_node

    run_dir = load_node(config_dir).run_path
    preload(names)
    order = ForkServer(run_dir).run()
    return 0 if order is None else _run(order.config_dir, list(order.names))


def _node(config_dir: Path) -> int:
    from swarmd.parent import become
    from swarmware.errors import ConfigError
    from swarmware.model.config import load_node
    from swarmware.service.starting import GUARD

    node = load_node(config_dir)
    services = list(node.services)
    shared = node.processes == "per-daemon"
    if shared and GUARD not in services:
        raise ConfigError(
            f'{config_dir}/node.toml: processes = "per-daemon" needs the guard, which starts the others'
        )
    become(node.platform, config_dir, node.run_path, services, shared=shared)
