"""Command line of `swarmd`."""

import argparse
from pathlib import Path

from swarmware import __version__


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
    fork_server = commands.add_parser("forkserver")  # started by `swarmd node`: no help, so not listed
    fork_server.add_argument("services", nargs="*")
    fork_server.add_argument("--socket", metavar="PATH", type=Path, required=True)
    fork_server.add_argument("--shared", action="store_true")
    for command in (run, node, units):
        command.add_argument(
            "--config",
            metavar="DIR",
            type=Path,
            help="configuration folder with node.toml; default: SWARM_CONFIG, else /etc/swarm",
        )
    commands.add_parser("ls", help="list the services that are installed", epilog="Example: swarmd ls")
    return made
