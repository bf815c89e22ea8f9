"""`swarmctl keys init`: makes the swarm's root, and this computer's node its first member."""

import os
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.membership.activation import activate, show_activation
from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.root_folder import RootFolder
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.errors import Conflict
from swarmware.transport.enrolment.joiner import Credentials
from swarmware.transport.enrolment.token import fingerprint
from swarmware.transport.security.keys import SEED_BYTES
from swarmware.transport.security.root import Root, candidate

FIRST_ROLE: Final = "maintainer"


class MadeSwarm(msgspec.Struct, frozen=True):
    """A swarm that was made, with its first member."""

    swarm: str
    root: str
    """Folder of the root key."""
    fingerprint: str
    """Digest of the root's public key, hexadecimal."""
    platform: str
    role: str
    keys_dir: str
    running: bool
    """The node runs."""
    in_use: bool = False
    """The running node uses these keys."""


def make_root(out: Output, root_dir: Path | None, swarm: str, *, replace: bool = False) -> None:
    """Makes the root and the keys of the node on this computer, and prints where they are.

    `replace`: also where the node has keys.
    Raises: NotFound without a node; Conflict when the node has keys, or the root has other members;
    Denied, OSError when a folder cannot be written.
    """
    node, folder = NodeKeys.find(out.settings), RootFolder(root_dir)
    # before the root is made: a refusal leaves nothing behind
    node.check_free(replace=replace)
    with folder.locked():
        root = _unused_root(folder, node.platform, swarm)
        seed = os.urandom(SEED_BYTES)
        signed = root.admit(candidate(node.platform, FIRST_ROLE, seed, root.public))
        node.write(Credentials(seed, root.public, signed))
    running = node.runs
    activated = activate(out, node, others=False)
    made = MadeSwarm(
        root.roster.swarm,
        str(folder.path),
        fingerprint(root.public),
        node.platform,
        FIRST_ROLE,
        str(node.folder),
        running,
        activated.in_use,
    )
    show_made(out, made)
    show_activation(out, node.platform, activated, running=running, others=False)


def show_made(out: Output, made: MadeSwarm) -> None:
    """Prints the swarm that was made, and what follows."""
    if out.settings.structured:
        out.document(made)
    else:
        rows = [
            ("swarm", made.swarm),
            ("root key", made.root),
            ("fingerprint", made.fingerprint),
            ("first member", f"{made.platform}, {made.role}"),
            ("its keys", made.keys_dir),
        ]
        out.table([Column("WHAT"), Column("VALUE")], rows)
    out.say(f"keep a copy of {made.root} at a safe place: without it no member can be added or revoked")


def _unused_root(folder: RootFolder, platform: str, swarm: str) -> Root:
    """A root without other members, either new or from an interrupted `init`."""
    if not folder.exists:
        return Root.make(folder.path, swarm)
    root = folder.load()
    others = [member.platform for member in root.roster.valid() if member.platform != platform]
    # a root with other members is in use, and `init` is not a way to join it
    if others:
        raise Conflict(
            f"{folder.path}: the root of swarm {root.roster.swarm!r} with members {', '.join(others)};"
            f" expected `swarmctl keys invite {platform}` to add it, or another --root for a new swarm"
        )
    return root
