"""`swarmctl keys ls` and `keys show`: members of the swarm, as this computer's node or the root has them."""

import asyncio
import os
from pathlib import Path
from typing import Literal

import msgspec

from swarmctl.membership.distribution import reached_rosters
from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.root_folder import RootFolder
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column, Detail, rows_of
from swarmware.errors import NotFound
from swarmware.model.clock import utc_ns
from swarmware.transport.enrolment.token import fingerprint
from swarmware.transport.security.roster import Roster, RosterMember


class ListedMember(msgspec.Struct, frozen=True):
    """A member of the swarm, or a revoked former member."""

    platform: str
    role: str
    serial: int
    revoked: bool
    sign_public: str
    """Ed25519 public key, hexadecimal."""
    curve_public: str
    """X25519 public key, hexadecimal."""
    roster: int | None = None
    """Version of the node's roster, or None if it was not requested or the node not reached."""
    invited: Literal["", "open", "expired"] = ""
    """State of an invitation that no node has used yet, or "" without one; `expired`: no node can use it.

    Known only on the computer with the root.
    """


class MemberList(msgspec.Struct, frozen=True):
    """Members of the swarm."""

    members: list[ListedMember]
    swarm: str
    fingerprint: str
    """Digest of the root's public key, hexadecimal."""
    version: int
    """Version of the roster."""
    key_epoch: int
    """Number of the group key."""
    source: str
    """Folder with the roster."""


def list_members(out: Output, root_dir: Path | None) -> None:
    """Prints the members. Raises: as `known_members`."""
    found = known_members(out, root_dir)
    node = _node(out) if root_dir is None else None
    # the rosters of other nodes are asked through the running node; the files here need none
    asked = node is not None and node.runs
    if asked:
        found = asyncio.run(_with_rosters(out, found))
    found = _with_invitations(out, found, RootFolder(root_dir))
    if out.settings.structured:
        out.document(found)
        return
    details: list[Detail[ListedMember]] = [
        Detail("PLATFORM", value=lambda one: one.platform),
        Detail("ROLE", value=lambda one: one.role),
        Detail("SERIAL", value=lambda one: one.serial, right=True),
        Detail("STATE", value=_state),
        Detail("KEY", value=lambda one: one.sign_public, wide=True),
    ]
    if asked:
        details[-1:-1] = [
            Detail("ROSTER", value=lambda one: one.roster, right=True),
            Detail("SYNC", value=lambda one: _synchronous(one, found.version)),
        ]
    title = (
        f"swarm {found.swarm}, root {found.fingerprint}, roster {found.version}, group key {found.key_epoch}"
    )
    out.table(details, rows_of(details, found.members), title)


def show_member(out: Output, root_dir: Path | None, platform: str) -> None:
    """Prints one member; without a name the node on this computer.

    Raises: NotFound when it is not a member; as `known_members`.
    """
    name = platform or NodeKeys.find(out.settings).platform
    found = known_members(out, root_dir)
    members = [one for one in found.members if one.platform == name]
    if not members:
        known = ", ".join(one.platform for one in found.members)
        raise NotFound(f"{name}: not a member of swarm {found.swarm!r}; expected one of {known}")
    shown = msgspec.structs.replace(found, members=members)
    if out.settings.structured:
        out.document(shown)
        return
    # the last one, as a platform that was revoked and invited again is listed twice
    one = members[-1]
    rows = [
        ("platform", one.platform),
        ("role", one.role),
        ("serial", str(one.serial)),
        ("state", _state(one)),
        ("key", one.sign_public),
        ("swarm", found.swarm),
        ("root", found.fingerprint),
        ("roster", f"version {found.version}, group key {found.key_epoch}"),
        ("read from", found.source),
    ]
    out.table([Column("WHAT"), Column("VALUE")], rows)


def known_members(out: Output, root_dir: Path | None) -> MemberList:
    """The members: as a given root has them, else the node on this computer, else the usual root.

    Raises: NotFound when neither has a roster; ConfigError, Denied when it is damaged or not readable.
    """
    folder = RootFolder(root_dir)
    if root_dir is None:
        node = _node(out)
        if node is not None:
            keys = node.load()
            if keys.roster is not None:
                return _members(keys.roster, fingerprint(keys.root_public), node.folder)
        if not folder.exists:
            raise NotFound(
                "keys: this computer's node has none, and there is no root; expected `swarmctl keys init`"
                " for a new swarm, or `swarmctl keys join TOKEN`"
            )
    root = folder.load()
    return _members(root.roster, fingerprint(root.public), folder.path)


async def _with_rosters(out: Output, found: MemberList) -> MemberList:
    """The members with the roster that each node has now."""
    names = [one.platform for one in found.members if not one.revoked]
    versions = {one.platform: one.version for one in await reached_rosters(out, names, found.version)}
    members = [
        one if one.revoked else msgspec.structs.replace(one, roster=versions[one.platform])
        for one in found.members
    ]
    return msgspec.structs.replace(found, members=members)


def _with_invitations(out: Output, found: MemberList, folder: RootFolder) -> MemberList:
    """The members with the state of their files, if the root of this swarm is on this computer."""
    # the default folder may have the root of another swarm
    if not os.access(folder.path, os.R_OK | os.X_OK) or folder.fingerprint != found.fingerprint:
        return found
    files = folder.unused_files()
    seen = {(one.platform, one.serial) for one in found.members if one.roster is not None} & files.keys()
    if seen:
        # a roster that answers shows that its node has the credentials of the file
        folder.note_used(seen)
    utc_s, members = utc_ns() // 1_000_000_000, []
    for one in found.members:
        expires_s = None if one.revoked else files.get((one.platform, one.serial))
        if expires_s is None or (one.platform, one.serial) in seen:
            members.append(one)
            continue
        members.append(msgspec.structs.replace(one, invited="open" if utc_s < expires_s else "expired"))
        if utc_s >= expires_s:
            out.warn(
                f"{one.platform}: its file has expired, and no node was seen with it; expected"
                f" `swarmctl keys revoke {one.platform}`, unless it has joined meanwhile"
            )
    return msgspec.structs.replace(found, members=members)


def _state(member: ListedMember) -> str:
    """member | revoked | invited | invitation expired."""
    if member.revoked:
        return "revoked"
    return {"": "member", "open": "invited", "expired": "invitation expired"}[member.invited]


def _synchronous(member: ListedMember, version: int) -> str | None:
    if member.revoked or member.roster is None:
        return None
    return "yes" if member.roster >= version else "no"


def _node(out: Output) -> NodeKeys | None:
    try:
        node = NodeKeys.find(out.settings)
    except NotFound:
        return None
    return node if node.has_identity else None


def _members(roster: Roster, root: str, source: Path) -> MemberList:
    gone = frozenset(roster.revoked)
    listed = [_listed(member, revoked=member.serial in gone) for member in roster.members]
    return MemberList(listed, roster.swarm, root, roster.version, roster.key_epoch, str(source))


def _listed(member: RosterMember, *, revoked: bool) -> ListedMember:
    keys = member.sign_public.hex(), member.curve_public.hex()
    return ListedMember(member.platform, member.role, member.serial, revoked, *keys)
