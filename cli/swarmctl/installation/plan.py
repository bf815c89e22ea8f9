"""The steps that set a host up, and those that remove the node from it; each only where it is missing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from swarmctl.installation.configuration import GUARD_FILE, SELF, SYSTEMD, HostNode, NodeChoice, host_node
from swarmctl.installation.host import SERVICE_USER, Host
from swarmctl.installation.package import PROGRAMS, InstalledPackage
from swarmctl.installation.step import HostStep, link, remove, run, write
from swarmware.errors import Conflict

BIN: Final = "/usr/bin"
"""Where the units expect the programs."""
CONFIG: Final = "/etc/swarm"
KEYS: Final = f"{CONFIG}/keys"
RUN: Final = "/run/swarm"
UNITS: Final = "/etc/systemd/system"
SYSUSERS: Final = "/usr/lib/sysusers.d/swarm.conf"
TMPFILES: Final = "/usr/lib/tmpfiles.d/swarm.conf"
POLKIT: Final = ("/usr/lib/polkit-1/polkitd", "/usr/libexec/polkit-1/polkitd", "/usr/libexec/polkitd")
"""Places of the daemon of polkit."""
RULES: Final = "/etc/polkit-1/rules.d/50-swarm.rules"
TARGET: Final = "swarm.target"
WHOLE: Final = "swarm-node.service"
DAEMON: Final = "swarmd@.service"
UNIT_FILES: Final = (DAEMON, TARGET, WHOLE)
DAEMONS: Final = f"{UNITS}/swarm.target.wants"
AT_BOOT: Final = f"{UNITS}/multi-user.target.wants"


def has_polkit(host: Host) -> bool:
    """Whether polkit is installed, by which the guard may restart daemons."""
    return any(map(host.exists, POLKIT))


def units_of(node: HostNode) -> tuple[str, ...]:
    """Units of systemd that run this node."""
    if node.single_unit:
        return (WHOLE,)
    return (TARGET, *(f"swarmd@{name}.service" for name in node.services))


def install_steps(
    host: Host, package: InstalledPackage, node: HostNode, operators: tuple[str, ...], *, start: bool
) -> list[HostStep]:
    """What is missing on a host until the node runs there, and after each boot.

    Raises: Conflict when a program of another origin is in the way; NotFound for an unknown operator; Denied.
    """
    return [
        *_programs(host, package),
        *_user(host, package),
        *(write(f"{CONFIG}/{name}", content, "configuration") for name, content in node.files.items()),
        *_folders(host, package, node),
        *_operators(host, operators),
        *_units(host, package, node, start=start),
    ]


def _programs(host: Host, package: InstalledPackage) -> Iterator[HostStep]:
    for name in PROGRAMS:
        path, target = f"{BIN}/{name}", str(package.programs / name)
        if target == path or host.link(path) == target:
            continue
        # a link of a former installation is replaced, a file is not ours
        if host.exists(path) and host.link(path) is None:
            raise Conflict(f"{path}: a file of another installation; expected no file, or a link to {target}")
        yield link(path, target, "program")


def _user(host: Host, package: InstalledPackage) -> Iterator[HostStep]:
    content = (package.units / "swarm.sysusers").read_bytes()
    changed = host.content(SYSUSERS) != content
    if changed:
        yield write(SYSUSERS, content, "user of the daemons")
    # also after a removed user: the file alone does not create it
    if changed or host.user(SERVICE_USER) is None:
        yield run("user of the daemons", "systemd-sysusers", "swarm.conf")


def _folders(host: Host, package: InstalledPackage, node: HostNode) -> Iterator[HostStep]:
    owner = host.user(SERVICE_USER)
    content = (package.units / "swarm.tmpfiles").read_bytes()
    changed = host.content(TMPFILES) != content
    if changed:
        yield write(TMPFILES, content, "folders of the daemons")
    if changed or owner is None or not all(map(host.exists, (RUN, KEYS, node.data_dir))):
        yield run("folders of the daemons", "systemd-tmpfiles", "--create", "swarm.conf")
    # files of a backup may belong to the number that the user had on another host
    for folder in (KEYS, node.data_dir):
        if host.exists(folder) and (owner is None or host.not_owned(folder, owner)):
            yield run(
                "files of the daemons", "chown", "--recursive", f"{SERVICE_USER}:{SERVICE_USER}", folder
            )
    for path in host.closed_to(CONFIG, -1 if owner is None else owner[1]):
        if not path.startswith(f"{KEYS}/"):
            yield run("read by the daemons", "chgrp", SERVICE_USER, path)


def _operators(host: Host, operators: tuple[str, ...]) -> Iterator[HostStep]:
    for user in operators:
        if not host.is_member(user, SERVICE_USER):
            yield run("operator", "usermod", "--append", "--groups", SERVICE_USER, user)


def _units(host: Host, package: InstalledPackage, node: HostNode, *, start: bool) -> Iterator[HostStep]:
    rules = (package.units / "swarm.rules").read_bytes()
    if host.content(RULES) != rules:
        yield write(RULES, rules, "the guard restarts daemons")
    changed = False
    for name in UNIT_FILES:
        content = (package.units / name).read_bytes()
        if host.content(f"{UNITS}/{name}") != content:
            changed = True
            yield write(f"{UNITS}/{name}", content, "unit")
    if changed:
        yield run("read the units", "systemctl", "daemon-reload")
    wanted, enabled = units_of(node), enabled_units(host)
    # disabled first, since the single unit and the units of services exclude each other
    if unwanted := [unit for unit in enabled if unit not in wanted]:
        yield run("not in node.toml", "systemctl", "disable", "--quiet", "--now", *unwanted)
    if missing := [unit for unit in wanted if unit not in enabled]:
        yield run("starts at boot", "systemctl", "enable", "--quiet", *missing)
    states = host.states(wanted)
    if start and (idle := [unit for unit in wanted if states.get(unit) != "active"]):
        yield run("runs", "systemctl", "start", *idle)


def enabled_units(host: Host) -> list[str]:
    """Units of nodes that systemd starts at boot."""
    found = host.matches(DAEMONS, "swarmd@*.service")
    found += [path for name in (TARGET, WHOLE) for path in host.matches(AT_BOOT, name)]
    return [path.rpartition("/")[2] for path in found]


def removal_steps(host: Host, package: InstalledPackage, data_dir: str, *, purge: bool) -> list[HostStep]:
    """What removes the node from a host; configuration, keys, data and user only with `purge`."""
    return list(_removal(host, package, data_dir, purge=purge))


def _removal(host: Host, package: InstalledPackage, data_dir: str, *, purge: bool) -> Iterator[HostStep]:
    if enabled := enabled_units(host):
        yield run("no start at boot", "systemctl", "disable", "--quiet", "--now", *enabled)
    files = [f"{UNITS}/{name}" for name in UNIT_FILES if host.exists(f"{UNITS}/{name}")]
    if files:
        yield run("ends the node", "systemctl", "stop", "swarm.target", "swarmd@*.service", WHOLE)
    # drop-ins of systemctl edit would apply to a later installation
    files += host.matches(UNITS, "swarmd@*.service.d") + host.matches(UNITS, "swarm-node.service.d")
    yield from (remove(path, "unit") for path in files)
    if files:
        yield run("forget the units", "systemctl", "daemon-reload")
    yield from (remove(path, "rules") for path in (RULES, SYSUSERS, TMPFILES) if host.exists(path))
    if host.exists(RUN):
        yield remove(RUN, "folder of the daemons")
    for name in PROGRAMS:
        if host.link(f"{BIN}/{name}") == str(package.programs / name):
            yield remove(f"{BIN}/{name}", "program")
    if purge:
        yield from (
            remove(path, "configuration, keys, data") for path in (CONFIG, data_dir) if host.exists(path)
        )
        if host.user(SERVICE_USER) is not None:
            yield run("user of the daemons", "userdel", SERVICE_USER)
            # userdel leaves a group that has other members
            remains = f"! getent group {SERVICE_USER} > /dev/null || groupdel {SERVICE_USER}"
            yield run("group of the operators", "sh", "-c", remains)


def start_unit(unit: str, config_dir: Path, host: Host | None = None) -> None:
    """Start a node, now and at each boot. For the shipped units the host is set up as by `host install`.

    Raises: Denied without root, NotFound without systemd; Conflict when guard.toml is for the other shipped
    unit; InvalidInput, ConfigError; SwarmError with the message of systemctl, OSError.
    """
    host = host or Host()
    host.check_ready("fleet up")
    # a unit of the operator's own, of which nothing else is known
    if unit not in {TARGET, WHOLE} or str(config_dir) != CONFIG:
        host.run(["systemctl", "enable", unit])
        host.run(["systemctl", "start", unit])
        return
    package = InstalledPackage.find()
    package.check_visible()
    node = host_node(package.configuration, host.place(CONFIG), NodeChoice(single_unit=unit == WHOLE))
    if node.single_unit != (unit == WHOLE):
        raise Conflict(
            f'{config_dir / GUARD_FILE}: supervisor = "{SELF}"; expected "{SYSTEMD}" for unit {unit}'
        )
    for _ in host.carry_out(install_steps(host, package, node, (), start=True)):
        pass  # each step raises its error
