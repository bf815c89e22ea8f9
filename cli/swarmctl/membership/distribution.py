"""Distribution of a new roster: from the root to the node on this computer, and from there to the swarm."""

import asyncio
from collections.abc import Sequence
from typing import Final

import msgspec

from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.root_folder import RootFolder
from swarmctl.resources.fanout import read_boards
from swarmctl.session.session import NAME, Session, connect
from swarmctl.terminal.output import Output
from swarmware.errors import Denied, NotFound, SwarmError
from swarmware.module.client import Client
from swarmware.transport.enrolment.token import fingerprint
from swarmware.transport.security.root import Root
from swarmware.types.net import RosterState, SignedRoster

POLL_S: Final = 0.25
"""Polling period of the rosters of other nodes."""


class NodeRoster(msgspec.Struct, frozen=True):
    """State of the roster at one node."""

    platform: str
    version: int | None
    """Version of the node's roster, or None if the node was not reached."""
    synchronous: bool
    """Whether the node has the root's newest roster."""
    reason: str = ""
    """Why the node was not reached."""


def local_member(out: Output, root: Root) -> NodeKeys | None:
    """The node on this computer as a member of the root's swarm, or None without a node or its keys.

    Raises: Denied when it belongs to another swarm, or this user may not read its keys; ConfigError.
    """
    try:
        node = NodeKeys.find(out.settings)
    except NotFound:
        return None
    if not node.has_identity:
        return None
    found = node.load().root_public
    if found != root.public:
        raise Denied(
            f"{node.platform} belongs to the swarm of root {fingerprint(found)}, and this root is"
            f" {fingerprint(root.public)}; expected --root with the root of its swarm, or --config of"
            " another node"
        )
    return node


def current_root(out: Output, folder: RootFolder) -> Root:
    """The root in a folder; an older copy is updated with the newer roster of the node on this computer.

    Raises: as `RootFolder.load` and `local_member`; OSError when the folder cannot be written.
    """
    root = folder.load()
    node = local_member(out, root)
    keys = None if node is None else node.load()
    if keys is None or keys.roster is None or keys.roster.version <= root.roster.version:
        return root
    folder.continue_from(keys.signed)
    out.warn(
        f"{folder.path} has roster {root.roster.version}, and {keys.platform} has {keys.roster.version}: it"
        " is an older copy of the root, and continues from the newer roster"
    )
    return folder.load()


async def hand_over(out: Output, root: Root) -> bool:
    """Gives the root's roster to the node on this computer, which distributes it while it runs.

    Returns whether the node runs and has accepted the roster. Raises: as `local_member`; OSError when the
    folder of keys cannot be written.
    """
    node, version = local_member(out, root), root.roster.version
    if node is None:
        out.warn(
            f"no node of the swarm is on this computer: roster {version} stays with the root;"
            " expected a node here, which hands it on"
        )
        return False
    if not node.runs:
        node.take(root.signed)
        out.say(f"{node.platform} does not run: it takes roster {version} at its next start, and hands it on")
        return False
    try:
        async with Client(NAME, config_dir=node.config_dir) as module:
            await module.request(
                "sys/broker/roster",
                SignedRoster(root.signed),
                RosterState,
                timeout_s=out.settings.timeout_s,
            )
    # the roster is signed and therefore valid, whether the broker answers now or not
    except SwarmError as error:
        node.take(root.signed)
        out.warn(f"{node.platform} did not take roster {version} ({error}): it does at its next start")
        return False
    return True


async def follow(out: Output, root: Root) -> list[NodeRoster]:
    """The roster of each member, once all reachable members have the root's or after the time-out."""
    wanted = root.roster.version
    async with connect(out.settings, out) as session:
        members = [member.platform for member in root.roster.valid()]
        found: list[NodeRoster] = []
        try:
            async with asyncio.timeout(out.settings.timeout_s):
                async for _ in session.module.every(POLL_S):
                    found = await rosters(session, members, wanted)
                    if all(one.synchronous for one in found):
                        break
        except TimeoutError:
            pass  # not an error: the result shows which members are late
        return found or [NodeRoster(name, None, False, "no answer in time") for name in members]


async def reached_rosters(out: Output, platforms: Sequence[str], wanted: int) -> list[NodeRoster]:
    """The present roster of each node, requested through the running node on this computer."""
    async with connect(out.settings, out) as session:
        return await rosters(session, platforms, wanted)


async def rosters(session: Session, platforms: Sequence[str], wanted: int) -> list[NodeRoster]:
    """The present roster of each node, or the reason why it is not known."""
    states, errors = await read_boards(session, list(platforms), "net/roster", RosterState)
    return [
        NodeRoster(name, states[name].version, states[name].version >= wanted)
        if name in states
        else NodeRoster(name, None, False, str(errors[name]))
        for name in platforms
    ]
