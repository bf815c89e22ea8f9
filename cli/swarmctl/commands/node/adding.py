"""`swarmctl node add`: makes a platform known before it comes: its host in the file, and its invitation."""

import asyncio
from pathlib import Path

import msgspec

from swarmctl.membership.distribution import current_root
from swarmctl.membership.hosts_file import add_host
from swarmctl.membership.inviting import InvitationPlan, InvitedNode, check_plan, invite_nodes
from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.root_folder import RootFolder
from swarmctl.session.session import connect
from swarmctl.terminal.output import Output
from swarmware.errors import Conflict, InvalidInput, NoAnswer, NotFound


class NewNode(msgspec.Struct, frozen=True):
    """A platform that will be added."""

    platform: str
    address: str = ""
    """SSH address for the file of hosts."""
    kind: str = ""
    template: str = ""
    """Keys of its node.toml for the file of hosts."""

    @property
    def keys(self) -> dict[str, str]:
        """Given keys of the platform's node.toml."""
        return {name: value for name, value in (("kind", self.kind), ("template", self.template)) if value}


def add_node(
    out: Output, new: NewNode, plan: InvitationPlan, root_dir: Path | None, file: Path | None
) -> None:
    """Adds a platform; a repeated call continues an interrupted one.

    Raises: Conflict when the name is taken, InvalidInput for contradicting options; as `invite_nodes` and
    `add_host`.
    """
    check_plan(plan)
    if (file is None) != (not new.address):
        raise InvalidInput("--hosts and --address: one without the other; expected both, or none")
    if file is None and new.keys:
        raise InvalidInput(
            f"--{next(iter(new.keys))}: it is written to the file of --hosts; expected --hosts"
        )
    folder, keyed = RootFolder(root_dir), _has_keys(out)
    if keyed or root_dir is not None:
        if current_root(out, folder).roster.find(new.platform) is not None:
            raise Conflict(
                f"{new.platform}: a member of the swarm has this name; expected another name, `swarmctl node"
                f" remove {new.platform}` first, or `swarmctl keys invite {new.platform}` for a new computer"
                " of this platform"
            )
    elif file is None:
        raise NotFound(
            "the swarm has no keys, so that there is nothing to invite to; expected --hosts with --address,"
            " or keys (`swarmctl keys init`)"
        )
    # in a swarm without keys no roster lists the names, only the routes do
    if new.platform in asyncio.run(_reachable(out)):
        raise Conflict(f"{new.platform}: a node with this name runs; expected another name")
    if file is not None:
        # before the invitation, which waits until the node has joined and may be interrupted
        if add_host(file, new.platform, new.address, new.keys):
            out.say(f"{file}: host {new.platform} was added")
        else:
            out.say(f"{file}: host {new.platform} is in it already")
    if keyed or root_dir is not None:
        invite_nodes(out, root_dir, plan)
    elif out.settings.structured:
        out.line(InvitedNode(new.platform, "open", plan.role, "", "", 0, new.address))
    else:
        out.say(f"the swarm has no keys: {new.platform} needs no invitation, and must be on this computer")


def _has_keys(out: Output) -> bool:
    try:
        return NodeKeys.find(out.settings).has_identity
    except NotFound:
        return False


async def _reachable(out: Output) -> set[str]:
    """Platforms with a route now, or none without a running node here."""
    try:
        async with connect(out.settings, out) as session:
            return {session.here, *(route.platform for route in (await session.routes()).routes)}
    except (NoAnswer, NotFound):
        return set()
