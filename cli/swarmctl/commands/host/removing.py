"""`swarmctl host uninstall`: stops the node and removes it from systemd."""

import asyncio
from pathlib import Path

from swarmctl.commands.host.installing import show_steps
from swarmctl.installation.host import Host
from swarmctl.installation.package import InstalledPackage
from swarmctl.installation.plan import CONFIG, removal_steps
from swarmctl.resources.restart import is_armed
from swarmctl.session.session import connect
from swarmctl.terminal.confirmation import confirm
from swarmctl.terminal.output import Output
from swarmware.errors import Denied, NoAnswer
from swarmware.model.config import NodeConfig, load_node
from swarmware.model.platform_kind import VEHICLES
from swarmware.transport.appfile.table import populated


def remove_node(out: Output, *, purge: bool, force: bool, yes: bool, dry_run: bool) -> None:
    """Removes the node from this computer.

    Raises: Denied without root, or for an armed vehicle unless `force`; NotFound without systemd; ConfigError
    for a damaged node.toml; SwarmError when a program failed, OSError; as `confirm`.
    """
    host, package = Host(), InstalledPackage.find()
    node = load_node(Path(CONFIG)) if (Path(CONFIG) / "node.toml").exists() else None
    platform = node.platform if node is not None else ""
    # without a node.toml the default folder may still have data of an earlier node
    steps = removal_steps(host, package, node.data_dir if node is not None else "/var/lib/swarm", purge=purge)
    if not dry_run:
        host.check_ready("host uninstall")
        if node is not None and not force:
            check_disarmed(out, node)
        kept = "; configuration, keys, settings and logs are removed, too" if purge else ""
        confirm(yes or not steps, f"stop {platform or 'the node'} and remove it from this computer{kept}")
    done = steps if dry_run else host.carry_out(steps)
    show_steps(out, platform, (), done, dry_run=dry_run)
    if not dry_run:
        out.say(f"the programs are still in {package.programs.parent}: rm -r {package.programs.parent}")


def check_disarmed(out: Output, node: NodeConfig) -> None:
    """Check that the node of this computer may be stopped.

    Raises: Denied for an armed vehicle, and for a vehicle that runs and does not answer.
    """
    # only a running vehicle can be in the air
    if node.kind not in VEHICLES or not populated(node.run_path):
        return

    async def armed() -> bool:
        async with connect(out.settings._replace(config=CONFIG), out) as session:
            return await is_armed(session)

    try:
        found = asyncio.run(armed())
    except NoAnswer as error:
        raise Denied(
            f"{node.platform} runs and does not answer, so it may be armed ({error}); expected --force"
        ) from error
    if found:
        raise Denied(f"{node.platform} is armed; expected a disarmed vehicle, or --force")
