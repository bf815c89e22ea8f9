"""The checks of `swarmctl doctor`: this computer, then each node by its files and its own findings."""

import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.commands.doctor.broker_checks import foreign, hostile_input, processor
from swarmctl.commands.doctor.check_result import CheckResult
from swarmctl.commands.doctor.computer_checks import check_computer
from swarmctl.commands.doctor.flight_loop import check_flight_loop
from swarmctl.commands.doctor.keys_check import check_keys
from swarmware.errors import ConfigError, SwarmError
from swarmware.model import paths
from swarmware.model.acl import FILE as ACL_FILE
from swarmware.model.acl import load_acl
from swarmware.model.clock import utc_ns
from swarmware.model.config import load_node
from swarmware.recorder.address import password_in, without_password
from swarmware.service.installed import find, load_config
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.shm.reap import reap

SOCKET_PATH_BYTES: Final = 107
"""Longest path of a Unix socket (sun_path without its zero)."""
DISK_LOW_BYTES: Final = 512 << 20

DATABASE_S: Final = 2.0
"""Time-out of the database: a server on the same network answers within milliseconds."""


def examine(folders: Mapping[str, Path], *, fix: bool) -> list[CheckResult]:
    """Runs all checks of this machine and of the nodes of these configuration folders, by platform.

    `fix` removes leftovers.
    """
    out = check_computer(set(map(_owner, folders.values())), fix=fix)
    for platform, folder in folders.items():
        out += [msgspec.structs.replace(one, platform=platform) for one in _node(folder, fix)]
    return out


def _owner(folder: Path) -> int:
    """User of the node that runs, else of this process."""
    try:
        return load_node(folder).run_path.stat().st_uid
    except (OSError, SwarmError):
        return os.getuid()


def _node(folder: Path, fix: bool) -> Iterator[CheckResult]:
    try:
        node = load_node(folder)
    except SwarmError as error:
        yield CheckResult("node.toml", "error", str(error), "correct the file")
        return
    yield CheckResult("node.toml", "ok", f"{folder}: platform {node.platform}, {len(node.services)} services")
    yield _access_rules(folder)
    # the longest name: the largest pid of Linux, and a number of two digits
    longest = len(str(paths.socket(node.run_path, "4194304-99")).encode())
    if longest > SOCKET_PATH_BYTES:
        text = f"{node.run_dir}: sockets in it would have paths of {longest} bytes"
        yield CheckResult(
            "run_dir", "error", text, f"choose a shorter run_dir: {SOCKET_PATH_BYTES} bytes at most"
        )
    table = AppTable(node.run_path)
    table.refresh(probe=True)
    alive = {entry.name for entry in table}
    missing = [name for name in node.services if name not in alive]
    if missing:
        text = f"not running: {', '.join(missing)}"
        yield CheckResult(
            "services", "error", text, f"swarmd node --config {folder}, or systemctl start swarm.target"
        )
    else:
        yield CheckResult("services", "ok", f"all {len(node.services)} services run")
    for text in table.rejections:
        yield CheckResult("applications", "warning", text, "end the program of that user, or remove its file")
    # with a living process the files may be its own
    if not len(table) and node.run_path.exists():
        if fix:
            reap(node.shm_path, node.run_path)
        yield CheckResult(
            "remains",
            "ok",
            "files of dead processes were removed" if fix else "no process of the node runs",
            fixed=fix,
        )
    if (loop := check_flight_loop(node, table)) is not None:
        yield CheckResult("flight loop", *loop)
    if "broker" in alive:
        yield processor(node.shm_path)
        yield from foreign(node.shm_path)
        yield from hostile_input(node.shm_path)
    # a node without processes cannot be joined
    if alive:
        from swarmctl.commands.doctor.joined_checks import check_joined  # joins the node

        yield from check_joined(folder, alive)
    yield from _settings(folder, node.services)
    for found in check_keys(folder / node.keys_dir, node.platform, utc_ns() / 1e9):
        yield CheckResult("keys", *found)
    yield _disk(node.data_path)


def _access_rules(folder: Path) -> CheckResult:
    try:
        acl = load_acl(folder)
    except SwarmError as error:
        advice = (
            "correct the file; until then a running node keeps its former rules, and does not start again"
        )
        return CheckResult(ACL_FILE, "error", str(error), advice)
    return CheckResult(ACL_FILE, "ok", f"{len(acl.rule)} rules, {len(acl.operator)} users or groups")


def _settings(folder: Path, services: Iterable[str]) -> Iterator[CheckResult]:
    """Whether the files below services/ are valid, and whether the logger's database answers."""
    for name in services:
        try:
            service = find(name)
            config = load_config(service, folder)
        except SwarmError as error:
            yield CheckResult(
                paths.service_config(folder, name).name, "error", str(error), "correct the file"
            )
            continue
        if uri := getattr(config, "mongodb_uri", ""):
            yield _database(paths.service_config(folder, service.settings_of or name), uri)


def _database(path: Path, uri: str) -> CheckResult:
    try:
        from swarmware.recorder.mongo import MongoStore

        store = MongoStore(uri, timeout_s=DATABASE_S, answer_s=DATABASE_S)
    except ConfigError as error:
        return CheckResult(
            "mongodb",
            "error",
            f"{path}: {error}",
            "correct the address or install the missing package; local logging continues",
        )
    # before the server is asked, since a readable password is the larger problem
    if password_in(uri) and path.stat().st_mode & 0o007:
        text = f"{path}: its password is readable by all users"
        store.close()
        return CheckResult("mongodb", "warning", text, f"chgrp swarm {path} && chmod 0640 {path}")
    try:
        store.ping()
    except SwarmError as error:
        return CheckResult(
            "mongodb", "warning", str(error), "start the server; the local ring stores the log meanwhile"
        )
    finally:
        store.close()
    return CheckResult("mongodb", "ok", f"{without_password(uri)} answers")


def _disk(path: Path) -> CheckResult:
    # the folder is made at the first start, on the file system of its parent
    while not path.exists():
        path = path.parent
    free = shutil.disk_usage(path).free
    low = free < DISK_LOW_BYTES
    advice = "remove old logs, or reduce ring_bytes in logger.toml" if low else ""
    return CheckResult(
        "disk", "warning" if low else "ok", f"{free >> 20} MiB free for logs at {path}", advice
    )
