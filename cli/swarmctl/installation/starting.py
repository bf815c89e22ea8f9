"""Starts the node of this host by a unit of systemd, and sets the host up for it before."""

from pathlib import Path

from swarmctl.installation.configuration import GUARD_FILE, SELF, SYSTEMD, NodeChoice, host_node
from swarmctl.installation.host import Host
from swarmctl.installation.package import InstalledPackage
from swarmctl.installation.plan import CONFIG, TARGET, WHOLE, install_steps
from swarmware.errors import Conflict


def start_unit(unit: str, config_dir: Path, host: Host | None = None) -> None:
    """Start a node, now and at each boot. For the shipped units the host is set up as by `host install`.

    Raises: Denied without root, NotFound without systemd; Conflict when guard.toml is for the other shipped
    unit; InvalidInput, ConfigError; SwarmError with the message of systemctl, OSError.
    """
    host = host or Host()
    host.check_ready("fleet up")
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
