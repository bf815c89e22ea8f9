"""`swarmctl keys revoke` and `keys rotate`: the root signs a roster, and this computer's node hands it on."""

from collections.abc import Callable
from pathlib import Path

import msgspec

from swarmctl.commands.keys.distribution import hand_over, local_member
from swarmctl.commands.keys.root_folder import RootFolder
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


def revoke(out: Output, root_dir: Path | None, platforms: tuple[str, ...], *, yes: bool) -> None:
    """Revokes members and changes the group key.

    Raises: NotFound for a platform that is not a member, InvalidInput for the node on this computer; as
    `confirm` and `hand_over`.
    """
    folder = RootFolder(root_dir)
    root = folder.load()
    node = local_member(out, root)
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
    local_member(out, folder.load())
    _change(out, folder, lambda root: root.rotate(), ())


def _change(
    out: Output, folder: RootFolder, change: Callable[[Root], bytes], revoked: tuple[str, ...]
) -> None:
    with folder.locked():
        root = folder.load()
        change(root)
    roster = root.roster
    hand_over(out, root)
    members = [member.platform for member in roster.valid()]
    if out.settings.structured:
        changed = RosterChanged(roster.swarm, roster.version, roster.key_epoch, members, list(revoked))
        out.document(changed)
        return
    columns = [Column("ROSTER", right=True), Column("GROUP KEY", right=True), Column("MEMBERS")]
    out.table(columns, [(roster.version, roster.key_epoch, ", ".join(members))])
