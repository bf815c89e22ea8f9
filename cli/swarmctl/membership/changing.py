"""`swarmctl keys revoke` and `rotate`: the root signs a roster, and the node here distributes it."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import msgspec

from swarmctl.membership.distribution import (
    NodeRoster,
    current_root,
    follow,
    hand_over,
    local_member,
)
from swarmctl.membership.root_folder import RootFolder
from swarmctl.terminal.confirmation import confirm
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.errors import InvalidInput
from swarmware.transport.security.root import Root


class RosterChanged(msgspec.Struct, frozen=True):
    """A roster that the root has signed."""

    swarm: str
    version: int
    key_epoch: int
    members: list[str]
    """Platforms that are members now."""
    revoked: list[str]
    """Platforms that the command revoked."""
    nodes: list[NodeRoster]
    """Roster of each member, or [] if no node runs here to distribute it."""


def revoke(out: Output, root_dir: Path | None, platforms: tuple[str, ...], *, yes: bool) -> None:
    """Revokes members and changes the group key.

    Raises: NotFound for a platform that is not a member, InvalidInput for the node on this computer, and the
    errors of `confirm` and `hand_over`.
    """
    folder = RootFolder(root_dir)
    root = current_root(out, folder)
    node = local_member(out, root)
    # a revoked node is not trusted by the others any more, so the roster would not reach them
    if node is not None and node.platform in platforms:
        raise InvalidInput(
            f"{node.platform}: the node on this computer hands the roster on; expected the revocation from"
            " another member with the root key"
        )
    confirm(yes, f"revoke {', '.join(platforms)}: out of swarm {root.roster.swarm!r} until invited again")
    _change(out, folder, lambda root: root.revoke(*dict.fromkeys(platforms)), platforms)


def rotate(out: Output, root_dir: Path | None) -> None:
    """Changes the group key of the swarm. Raises: as `hand_over`."""
    folder = RootFolder(root_dir)
    current_root(out, folder)
    _change(out, folder, lambda root: root.rotate(), ())


def signed(
    out: Output, folder: RootFolder, change: Callable[[Root], bytes], revoked: tuple[str, ...]
) -> RosterChanged:
    """Applies a change to the roster and distributes it. Raises: as `hand_over` and the change."""
    with folder.locked():
        root = folder.load()  # again under the lock: another command may have signed a roster meanwhile
        change(root)
    roster = root.roster
    nodes = asyncio.run(_distribute(out, root))
    members = [member.platform for member in roster.valid()]
    return RosterChanged(roster.swarm, roster.version, roster.key_epoch, members, list(revoked), nodes)


def warn_late(out: Output, changed: RosterChanged) -> None:
    """Warns of members that do not have the roster yet."""
    if late := [one.platform for one in changed.nodes if not one.synchronous]:
        out.warn(
            f"{', '.join(late)}: without roster {changed.version} yet; each takes it when it is in reach"
        )


def _change(
    out: Output, folder: RootFolder, change: Callable[[Root], bytes], revoked: tuple[str, ...]
) -> None:
    changed = signed(out, folder, change, revoked)
    if out.settings.structured:
        out.document(changed)
        return
    if not changed.nodes:
        columns = [Column("ROSTER", right=True), Column("GROUP KEY", right=True), Column("MEMBERS")]
        out.table(columns, [(changed.version, changed.key_epoch, ", ".join(changed.members))])
        return
    columns = [Column("NODE"), Column("ROSTER", right=True), Column("SYNC"), Column("REASON")]
    rows = [
        (one.platform, one.version, "yes" if one.synchronous else "no", one.reason or None)
        for one in changed.nodes
    ]
    out.table(columns, rows)
    warn_late(out, changed)


async def _distribute(out: Output, root: Root) -> list[NodeRoster]:
    return await follow(out, root) if await hand_over(out, root) else []
