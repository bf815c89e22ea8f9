"""`swarmd`: runs daemons of a node."""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from swarmware.errors import SwarmError

FAILED_S: Final = 2.0
"""Minimum lifetime of a failing process under systemd, which would restart it without a pause."""


class Options:
    """The options of `swarmd` from its command line."""

    def __init__(self, command: str = "", services: Sequence[str] = (), config: Path | None = None) -> None:
        self.command = command
        self.services = list(services)
        self.config = config
        self.socket = Path()
        self.shared = False


def parse(words: list[str]) -> Options:
    """Parses the command line.

    `run NAME… --config DIR`, the command with which the parent starts its node, is parsed without argparse,
    which with `shutil` would occupy 0.6 MB in each node.
    """
    match words:
        case ["run", *names, "--config", folder] if names and not any(
            word.startswith("-") for word in (*names, folder)
        ):
            return Options("run", names, Path(folder))
    from swarmd.command_line import parser

    return parser().parse_args(words, Options())


def main(args: list[str] | None = None) -> int:
    """Runs one command; an error that the user can cause gives one line and an exit code."""
    options = parse(sys.argv[1:] if args is None else args)
    began_s = time.monotonic()
    failed = True
    try:
        code = _carry_out(options)
        failed = code != 0
        return code
    finally:
        # systemd restarts a failed unit at once and without limit
        if failed and os.environ.get("SYSTEMD_EXEC_PID") == str(os.getpid()):
            time.sleep(max(0.0, began_s + FAILED_S - time.monotonic()))


def _carry_out(options: Options) -> int:
    try:
        match options.command:
            case "ls":
                return _list()
            case "units":
                return _units(_folder(options.config))
            case "node":
                return _node(_folder(options.config))
            case "forkserver":
                return _fork_server(options)
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
    from swarmware.footprint.entry_points import none_is_foreign
    from swarmware.footprint.event_loop import import_without_tls

    if none_is_foreign():
        import_without_tls("uvloop")


def _run(config_dir: Path, names: list[str]) -> int:
    _import_event_loop()
    from swarmware.service.runner import run_services

    return run_services(config_dir, list(dict.fromkeys(names)))


def _fork_server(options: Options) -> int:
    _import_event_loop()
    from swarmd.fork_server import ForkServer, preload

    preload(options.services)
    order = ForkServer(options.socket, shared=options.shared).run()
    return 0 if order is None else _run(order.config_dir, list(order.names))


def _node(config_dir: Path) -> int:
    from swarmd.parent import become
    from swarmware.errors import ConfigError
    from swarmware.model.config import load_node
    from swarmware.node.incarnation import check_folders
    from swarmware.service.starting import GUARD

    node = load_node(config_dir)
    check_folders(node.run_path, node.shm_path)
    services = list(node.services)
    shared = node.processes == "per-daemon"
    if shared and GUARD not in services:
        raise ConfigError(
            f'{config_dir}/node.toml: processes = "per-daemon" needs the guard, which starts the others'
        )
    fork_server = shared or node.fork_server
    become(node.platform, config_dir, node.run_path, services, shared=shared, fork_server=fork_server)
