"""Checks of this computer, whether or not a node runs on it."""

import os
import shutil
import socket
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from swarmctl.commands.doctor.check_result import CheckResult
from swarmctl.session import labs
from swarmware.errors import SwarmError
from swarmware.model.config import share_dir

SHM_LOW_BYTES: Final = 64 << 20


def check_computer(users: set[int], *, fix: bool) -> list[CheckResult]:
    """Results of all checks of this computer; `users`: users of its nodes; `fix` removes leftovers."""
    out = [_python(), _share(), _shared_memory(), _multicast()]
    out += [_remove_ipc(uid) for uid in sorted(users or {os.getuid()})]
    return [*out, *_leftovers(fix)]


def _python() -> CheckResult:
    version = ".".join(map(str, sys.version_info[:3]))
    fits = sys.version_info >= (3, 11)
    return CheckResult(
        "python", "ok" if fits else "error", f"Python {version}", "" if fits else "install 3.11 or later"
    )


def _share() -> CheckResult:
    try:
        return CheckResult("share", "ok", f"templates and missions in {share_dir()}")
    except SwarmError as error:
        return CheckResult("share", "error", str(error), "install the package again, or set SWARM_SHARE")


def _shared_memory() -> CheckResult:
    try:
        usage = shutil.disk_usage("/dev/shm")
    except OSError as error:
        return CheckResult(
            "shared memory", "error", f"/dev/shm: {error}", "mount a tmpfs there, or set shm_dir"
        )
    if not os.access("/dev/shm", os.W_OK):
        return CheckResult(
            "shared memory", "error", "/dev/shm cannot be written", "set its mode to 1777, or set shm_dir"
        )
    low = usage.free < SHM_LOW_BYTES
    advice = "increase its size (containers: --shm-size), or remove files from it" if low else ""
    return CheckResult(
        "shared memory", "warning" if low else "ok", f"{usage.free >> 20} MiB free in /dev/shm", advice
    )


def _multicast() -> CheckResult:
    """Sends a multicast datagram over loopback and receives it, as nodes of a lab do."""
    group, interface = "239.255.7.7", "127.0.0.1"
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            # any free port: the broker's own may be in use by a running node
            receiver.bind(("", 0))
            joined = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton(interface))
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, joined)
            receiver.settimeout(1.0)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
            sender.sendto(b"swarm", (group, receiver.getsockname()[1]))
            receiver.recv(16)
    except OSError as error:
        return CheckResult(
            "multicast", "warning", f"loopback: {error}", "list the other nodes as seeds in broker.toml"
        )
    return CheckResult("multicast", "ok", "loopback delivers datagrams")


def _remove_ipc(uid: int) -> CheckResult:
    """Checks RemoveIPC of logind, which removes the shared memory of an ordinary user at logout."""
    text = ""
    for path in [Path("/etc/systemd/logind.conf"), *Path("/etc/systemd/logind.conf.d").glob("*.conf")]:
        try:
            text += path.read_text() + "\n"
        except OSError:  # no such file: logind's default applies
            continue
    off = any(line.strip().lower() == "removeipc=no" for line in text.splitlines())
    # without logind nothing is removed at logout
    managed = Path("/run/systemd/seats").exists()
    # logind spares system users, whose numbers are lower
    ordinary = uid >= 1000
    if managed and ordinary and not off:
        return CheckResult(
            "logout",
            "warning",
            "logind removes this user's shared memory at logout",
            "run nodes as the system user `swarm`, or set RemoveIPC=no in logind.conf",
        )
    return CheckResult("logout", "ok", "shared memory survives a logout")


def _leftovers(fix: bool) -> Iterator[CheckResult]:
    known = {node.shm_dir for lab in labs.running_labs() for node in lab.nodes}
    prefix = f"swarm-{os.getuid()}-"
    # by this user's prefix: the folders of other users are not ours to judge
    stale = [path for path in Path("/dev/shm").glob(f"{prefix}*") if str(path) not in known]
    if not stale:
        yield CheckResult("leftovers", "ok", "no shared memory of labs that ended")
        return
    names = ", ".join(path.name for path in stale[:4]) + (" …" if len(stale) > 4 else "")
    if fix:
        for path in stale:
            shutil.rmtree(path, ignore_errors=True)
    yield CheckResult(
        "leftovers",
        "ok" if fix else "warning",
        f"{len(stale)} folders of labs that ended: {names}",
        "" if fix else "swarmctl doctor --fix removes them",
        fixed=fix,
    )
