"""The checks of `swarmctl doctor`: each reports a problem and its remedy."""

import contextlib
import os
import shutil
import socket
import struct
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import msgspec

from swarmctl.commands.doctor.flight_loop import check_flight_loop
from swarmctl.commands.doctor.keys_check import check_keys
from swarmctl.session import labs
from swarmware.errors import ConfigError, SwarmError
from swarmware.model import paths
from swarmware.model.acl import FILE as ACL_FILE
from swarmware.model.acl import load_acl
from swarmware.model.clock import utc_ns
from swarmware.model.config import load_node, share_dir
from swarmware.model.frame import decode
from swarmware.recorder.address import password_in, without_password
from swarmware.service.installed import find, load_config
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.security.keys import FORMER_MAX
from swarmware.transport.shm.layout import ring_file
from swarmware.transport.shm.reap import reap
from swarmware.transport.shm.ring import RingReader
from swarmware.types import registry
from swarmware.types.net import CERTAINLY_HOSTILE, HOSTILE, Traffic

if TYPE_CHECKING:
    from swarmctl.commands.doctor.node_findings import ComputerFaults, NodeFindings

SOCKET_PATH_BYTES: Final = 107
"""Longest path of a Unix socket (sun_path without its zero)."""
SHM_LOW_BYTES: Final = 64 << 20
DISK_LOW_BYTES: Final = 512 << 20

DATABASE_S: Final = 2.0
"""Time-out of the database: a server on the same network answers within milliseconds."""

REFUSALS_SHOWN: Final = 8
"""Maximum number of lines about denied requests."""

ADVICE: Final = {
    "forward": "it forwards frames that their senders did not sign: revoke it, or upgrade it",
    "late": "a slow link (swarmctl link ls), or another member repeats recorded commands",
    "relay": "revoke it, unless other nodes deny one from which it takes these values",
    "beacon": "a member has the group key and forges: find it by its address, revoke it",
    "key": "compare root, roster and key of `swarmctl keys show` there with `swarmctl keys show NAME` here:"
    " `swarmctl keys invite`, then `swarmctl keys join --replace` there; if a member forges, revoke it",
    "connect": "stop it, or give it keys: swarmctl keys invite; block outsiders by a firewall",
}
"""What to do about a denial, by its verb."""
MISSED: Final = (
    "a member with an old roster joins again: `swarmctl keys invite`, then `swarmctl keys join --replace`"
)

Verdict = Literal["ok", "warning", "error"]


class CheckResult(msgspec.Struct, frozen=True):
    """Result of one check."""

    check: str
    verdict: Verdict
    text: str
    advice: str = ""
    fixed: bool = False
    platform: str = ""
    """Platform of the node; empty: a check of this machine."""


def examine(folders: Mapping[str, Path], *, fix: bool) -> list[CheckResult]:
    """Runs all checks of this machine and of the nodes of these configuration folders, by platform.

    `fix` removes leftovers.
    """
    out = [_python(), _share(), _shared_memory(), _multicast()]
    out += [_remove_ipc(uid) for uid in sorted({*map(_owner, folders.values())} or {os.getuid()})]
    out += _leftovers(fix)
    for platform, folder in folders.items():
        out += [msgspec.structs.replace(one, platform=platform) for one in _node(folder, fix)]
    return out


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


def _owner(folder: Path) -> int:
    """User of the node that runs, else of this process."""
    try:
        return load_node(folder).run_path.stat().st_uid
    except (OSError, SwarmError):
        return os.getuid()


def _remove_ipc(uid: int) -> CheckResult:
    """Checks RemoveIPC of logind, which removes the shared memory of an ordinary user at logout."""
    text = ""
    for path in [Path("/etc/systemd/logind.conf"), *Path("/etc/systemd/logind.conf.d").glob("*.conf")]:
        try:
            text += path.read_text() + "\n"
        except OSError:  # no such file: logind's default applies
            continue
    off = any(line.strip().lower() == "removeipc=no" for line in text.splitlines())
    managed = Path("/run/systemd/seats").exists()
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


def _node(folder: Path, fix: bool) -> Iterator[CheckResult]:
    try:
        node = load_node(folder)
    except SwarmError as error:
        yield CheckResult("node.toml", "error", str(error), "correct the file")
        return
    yield CheckResult("node.toml", "ok", f"{folder}: platform {node.platform}, {len(node.services)} services")
    yield _access_rules(folder)
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
    for text in table.misfits:
        yield CheckResult("applications", "warning", text, "end the program of that user, or remove its file")
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
    if alive:
        yield from _present(folder, alive)
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


def hostile_input(shm_dir: Path) -> Iterator[CheckResult]:
    """Input that the broker refused and no valid member sends, beside what `foreign` reports."""
    try:
        traffic = _traffic(shm_dir)
    except SwarmError:
        return  # `processor` reports a board that cannot be read
    if traffic is None:
        return
    counts = msgspec.structs.asdict(traffic.refused)
    if traffic.refused.undated:
        text = f"{traffic.refused.undated} commands came before the first beacon of their sender"
        yield CheckResult("undated", "ok", f"{text}, which repeats them")
    found = ", ".join(f"{counts[name]} {name}" for name in HOSTILE if counts[name])
    if not any(counts[name] for name in CERTAINLY_HOSTILE):
        yield CheckResult("refused", "ok", found or "no forged or repeated input")
        return
    advice = "swarmctl log shows the platforms; revoke a member that does this, block outsiders by a firewall"
    yield CheckResult("refused", "warning", found, advice)


def processor(shm_dir: Path) -> CheckResult:
    """Whether the broker sends its beacons in time, from its board `net/traffic`."""
    try:
        traffic = _traffic(shm_dir)
    except SwarmError as error:
        return CheckResult(
            "processor", "warning", f"net/traffic cannot be read: {error}", "swarmctl traffic ls"
        )
    if traffic is None:
        return CheckResult("processor", "ok", "the broker has just started")
    if traffic.slowdown > 1:
        text = (
            f"processor overloaded: beacons {traffic.slowdown:g} times rarer ({traffic.slowed_ticks} so far)"
        )
        return CheckResult("processor", "warning", text, "run fewer services or nodes on this computer")
    return CheckResult(
        "processor", "ok", f"{traffic.tick_hz:g} beacons a second, {traffic.slowed_ticks} delayed so far"
    )


def foreign(shm_dir: Path) -> Iterator[CheckResult]:
    """Whether nodes with keys of another swarm are in reach, from the broker's board `net/traffic`."""
    try:
        traffic = _traffic(shm_dir)
    except SwarmError:
        return  # `processor` reports a board that cannot be read
    if traffic is None:
        return
    refused = traffic.refused
    if refused.forged:
        text = (
            f"{refused.forged} datagrams that no member has sealed, and that name no other swarm: forged, or"
            f" of a member that missed more than {FORMER_MAX} changes of the group key"
        )
        yield CheckResult("keys", "warning", text, f"block outsiders by a firewall; {MISSED}")
    for other in traffic.other_swarms:
        what = f"another swarm, root {other.root}…" if other.root else "nodes without keys"
        text = f"{what}, on this network: {other.datagrams} datagrams from {', '.join(other.addresses)}"
        advice = (
            "where a node there belongs to this swarm, compare `root` of `swarmctl keys show`, then `swarmctl"
            " keys invite` here and `swarmctl keys join --replace` there; otherwise give one swarm another"
            " udp_port or multicast_group in broker.toml"
        )
        yield CheckResult("keys", "warning", text, advice)
    if refused.other_epoch:
        text = (
            f"{refused.other_epoch} datagrams with a group key that is not known here: normal for seconds"
            f" after a change; if they continue, this node or their sender missed more than {FORMER_MAX}:"
            f" {MISSED}"
        )
        yield CheckResult("keys", "ok", text)


def _traffic(shm_dir: Path) -> Traffic | None:
    """The counters of the broker; None before the first. Raises: SwarmError when they cannot be read."""
    with contextlib.closing(RingReader(ring_file(shm_dir, "net/traffic"))) as ring:
        data = ring.newest()
    if data is None:
        return None
    frame = decode(data)
    return registry.decode(Traffic, frame.payload, frame.codec)


def _present(folder: Path, alive: Collection[str]) -> Iterator[CheckResult]:
    """Findings of the node itself."""
    from swarmctl.commands.doctor.node_findings import query_node

    try:
        present = query_node(folder)
    except SwarmError as error:
        yield CheckResult(
            "faults", "warning", f"the node cannot be joined: {error}", "run swarmctl as its user, or as root"
        )
        return
    own, *others = present.computers
    if "health" in alive:
        yield from _monitored(own, "swarmctl app ls shows whether `health` hangs")
    for other in others:
        yield from _monitored(other, "swarmctl node ls --units shows whether it answers")
    if present.unreached:
        text = f"members that this node does not reach: {', '.join(present.unreached)}"
        advice = (
            "whether they run; cable or radio; multicast_interface or seeds in broker.toml; UDP port 7447 and"
            " the ports of broker.toml in their firewalls, and in that of this computer; the same `root` in"
            " `swarmctl keys show` there"
        )
        yield CheckResult("members", "warning", text, advice)
    elif present.members:
        yield CheckResult("members", "ok", f"all {present.members} other members are reached")
    if present.unanswered:
        text = f"received, but not connected: {', '.join(present.unanswered)}"
        advice = (
            "a link of one direction (`swarmctl link ls`), or they refuse the key of this node:"
            " `swarmctl doctor` there names it"
        )
        yield CheckResult("links", "warning", text, advice)
    yield from _outages(present)
    for one in present.refusals[:REFUSALS_SHOWN]:
        what = one.path or one.verb
        text = f"{one.sender}: {what}: {one.count} times, last {one.age_s:.0f} s ago"
        advice = ADVICE.get(one.verb, "give the sender that role in the roster or in acl.toml, or stop it")
        yield CheckResult("denied", "warning", f"{text}: {one.reason}", advice)
    if more := present.refusals[REFUSALS_SHOWN:]:
        yield CheckResult(
            "denied", "warning", f"{sum(one.count for one in more)} times in {len(more)} other cases"
        )


def _outages(present: "NodeFindings") -> Iterator[CheckResult]:
    """Outages of links: where vehicles move, several of one link are a problem and one is not."""
    from swarmctl.commands.doctor.outages import WINDOW_S, lost_links, unsteady_links

    if present.outages is None:
        return
    now_ns = utc_ns()
    lost, unsteady = (", ".join(found(present.outages, now_ns)) for found in (lost_links, unsteady_links))
    if unsteady:
        text = f"links that do not hold, in the last {WINDOW_S / 60:.0f} min: {unsteady}"
        yield CheckResult("outages", "warning", text, "swarmctl link outages; swarmctl link ls shows loss")
    elif present.outages:
        yield CheckResult("outages", "ok", f"links lost now: {lost or 'none'} (swarmctl link outages)")


def _monitored(computer: "ComputerFaults", silent: str) -> Iterator[CheckResult]:
    """Faults of one computer of the platform, named where it has several; `silent`: advice without answer."""
    of = f"{computer.computer}: " if computer.computer else ""
    for fault in computer.faults:
        verdict: Verdict = "error" if fault.level == "error" else "warning"
        only = f" -n {computer.computer}" if of else ""
        text = f"{of}{fault.check}: {fault.state}: {fault.what}"
        yield CheckResult("fault", verdict, text, f"swarmctl health faults{only}")
    if computer.silent:
        yield CheckResult("faults", "error", f"{of}{computer.silent}", silent)
    elif not computer.faults:
        yield CheckResult("faults", "ok", f"{of}{'its monitor' if of else 'the node'} has found none")


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
    while not path.exists():
        path = path.parent
    free = shutil.disk_usage(path).free
    low = free < DISK_LOW_BYTES
    advice = "remove old logs, or reduce ring_bytes in logger.toml" if low else ""
    return CheckResult(
        "disk", "warning" if low else "ok", f"{free >> 20} MiB free for logs at {path}", advice
    )
