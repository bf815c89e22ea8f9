"""`swarmctl host install`: plans the steps, carries them out, and prints them."""

from collections.abc import Iterable
from pathlib import Path

import msgspec

from swarmctl.installation.configuration import NodeChoice, host_node
from swarmctl.installation.host import Host
from swarmctl.installation.package import InstalledPackage
from swarmctl.installation.plan import CONFIG, KEYS, has_polkit, install_steps, units_of
from swarmctl.installation.step import HostStep
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.transport.security.keys import NODE_KEY


class HostChange(msgspec.Struct, frozen=True):
    """One step that was carried out, or would be."""

    action: str
    """write, link, remove, run."""
    target: str
    """Path, or command."""
    reason: str


class HostChanged(msgspec.Struct, frozen=True):
    """Changes on this computer."""

    platform: str
    """Platform of the computer's node, or "" without a node."""
    units: tuple[str, ...]
    """Units of systemd that run the node."""
    dry_run: bool
    """Nothing was changed."""
    steps: tuple[HostChange, ...]


def install_node(
    out: Output, choice: NodeChoice, operators: tuple[str, ...], *, start: bool, dry_run: bool
) -> None:
    """Sets this computer up, and starts its node.

    Raises: Denied without root, NotFound without systemd or for an unknown operator; InvalidInput, Conflict
    and ConfigError for the configuration; SwarmError when a program failed, OSError.
    """
    host, package = Host(), InstalledPackage.find()
    # a dry run needs neither root nor systemd
    if not dry_run:
        host.check_ready("host install")
        package.check_visible()
    node = host_node(package.configuration, Path(CONFIG), choice)
    steps = install_steps(host, package, node, operators, start=start)
    done = steps if dry_run else host.carry_out(steps)
    show_steps(out, node.platform, units_of(node), done, dry_run=dry_run)
    if dry_run:
        return
    if not node.single_unit and not has_polkit(host):
        out.warn(
            "polkit is not installed: the guard cannot restart a daemon that hangs, and `app restart` fails;"
            " expected the package polkitd (apt-get install polkitd)"
        )
    new = " (for a new login of the operators: group swarm)" if operators else ""
    out.say(f"{node.platform} {'runs' if start else 'starts at the next boot'}: swarmctl node ls{new}")
    if not (Path(KEYS) / NODE_KEY).exists():
        out.say(
            "it serves only this computer until it has keys: `swarmctl keys init` makes a new swarm,"
            " `swarmctl keys join TOKEN` joins one"
        )


def show_steps(
    out: Output, platform: str, units: tuple[str, ...], steps: Iterable[HostStep], *, dry_run: bool
) -> None:
    """Prints steps as they are carried out. Raises: as the iteration over them."""
    changes = []
    for step in steps:
        changes.append(HostChange(str(step.action), step.target, step.reason))
        out.detail(f"{step.action} {step.target}")
    if out.settings.structured:
        out.document(HostChanged(platform, units, dry_run, tuple(changes)))
    elif changes:
        columns = [Column("ACTION"), Column("TARGET"), Column("REASON")]
        out.table(columns, [(one.action, one.target, one.reason) for one in changes])
    else:
        out.say("nothing to change")
