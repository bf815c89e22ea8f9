"""`swarmctl node rename`: gives the node on this computer another name; keys, settings and logs stay."""

import asyncio
import re
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.commandline.settings import CliSettings
from swarmctl.membership.distribution import current_root
from swarmctl.membership.hosts_file import rename_host
from swarmctl.membership.joining import credentials_for
from swarmctl.membership.node_keys import NodeKeys, check_member
from swarmctl.membership.root_folder import RootFolder
from swarmctl.session.session import connect
from swarmctl.terminal.confirmation import confirm
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.errors import Conflict, InvalidInput, NoAnswer, NotFound
from swarmware.model import document
from swarmware.model.config import NodeConfig, parse
from swarmware.model.names import check_platform
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.enrolment.joiner import Credentials
from swarmware.transport.enrolment.token import JoinToken
from swarmware.transport.security.keys import NODE_KEY, read_secret
from swarmware.transport.security.root import candidate
from swarmware.types.mission import INACTIVE, MissionStatus
from swarmware.types.rpc import Empty

_LINE: Final = re.compile(r"^(?P<key>\s*platform\s*=\s*)(?P<quote>[\"'])[^\"']*(?P=quote)", re.MULTILINE)
MODE: Final = 0o644


class NodeRenamed(msgspec.Struct, frozen=True):
    """A node with another name."""

    former: str
    platform: str
    config_dir: str
    keys: bool
    """Whether the node's key was admitted with the new name."""
    hosts: bool
    """Whether the node's entry in the file of hosts was renamed."""


class Renaming:
    """Change of the name of the node on this computer; each step can be repeated after an interruption."""

    def __init__(self, out: Output, former: str, platform: str) -> None:
        self._out = out
        self._former = check_platform(former)
        self._platform = check_platform(platform)
        self._found = NodeKeys.find(out.settings)

    def run(self, token: str, root_dir: Path | None, hosts_file: Path | None, *, yes: bool) -> None:
        """Renames the node, with the token of an invitation for the new name or by the root on this computer.

        Raises: NotFound when the node of this computer has another name; Conflict when it runs, or the name
        is taken; as `confirm`, `credentials_for` and `rename_host`.
        """
        found, former, platform = self._found, self._former, self._platform
        if found.platform != former:
            raise NotFound(
                f"{former}: the node on this computer is {found.platform} ({found.config_dir}); expected its"
                " name, --config DIR of another node, or the command on the computer of the node"
            )
        if former == platform:
            raise InvalidInput(f"{platform}: its present name; expected another one")
        # a running node would keep the former name in the swarm until its end
        if found.runs:
            asyncio.run(self._refuse_running())
        keyed = found.has_identity
        # made before the confirmation, so that a node.toml that cannot be edited stops the command early
        text = renamed(
            document.read(found.config_dir / "node.toml"), platform, str(found.config_dir / "node.toml")
        )
        if keyed and not token:
            self._check_free(root_dir)
        confirm(yes, f"rename {former} to {platform}: its resources have other paths from its next start")
        if keyed:
            self._admit(token, root_dir)
        # after the keys: until then the node keeps its former name, and a repeated call continues
        replace_file(found.config_dir / "node.toml", text.encode(), mode=MODE)
        hosts = hosts_file is not None and rename_host(hosts_file, former, platform)
        if keyed and not token:
            self._out.warn(
                f"the other nodes refuse {platform} until one of them has the new roster: `swarmctl keys"
                " rotate` with this root on the computer of another member hands it on"
            )
        self._show(NodeRenamed(former, platform, str(found.config_dir), keyed, hosts))

    async def _refuse_running(self) -> None:
        state = None
        try:
            async with connect(CliSettings(config=str(self._found.config_dir), timeout_s=2.0)) as session:
                state = (await session.ask("sys/mission/status", Empty(), MissionStatus)).state
        except (NoAnswer, NotFound):
            state = None
        if state is not None and state.state not in INACTIVE:
            raise Conflict(f"{self._former}: mission {state.mission} {state.state}; expected its end")
        raise Conflict(
            f"{self._former} runs; expected a stopped node (systemctl stop swarm.target 'swarmd@*', or end of"
            " `swarmd node`)"
        )

    def _check_free(self, root_dir: Path | None) -> None:
        roster = current_root(self._out, RootFolder(root_dir)).roster
        taken = roster.find(self._platform)
        # the same key under the new name is this node: an earlier call was interrupted after the admission
        if taken is not None and taken.sign_public != self._signing():
            raise Conflict(
                f"{self._platform}: another member of the swarm has this name; expected a free one"
            )

    def _admit(self, token: str, root_dir: Path | None) -> None:
        """Gets the roster in which the key of the node has the new name, and writes it."""
        if token:
            asked = JoinToken.parse(token)
            credentials_for(self._out, asked, self._platform, self._seed(), self._write)
        else:
            folder = RootFolder(root_dir)
            with folder.locked():
                root = folder.load()
                # the new name if an earlier call was interrupted after the admission
                member = root.roster.find(self._former) or root.roster.find(self._platform)
                role = "node" if member is None else member.role
                signed = root.admit(candidate(self._platform, role, self._seed(), root.public))
            self._write(Credentials(self._seed(), root.public, signed))

    def _write(self, found: Credentials) -> None:
        check_member(found, self._platform)
        self._found.replace_roster(found)

    def _seed(self) -> bytes:
        return read_secret(self._found.folder / NODE_KEY)

    def _signing(self) -> bytes:
        from swarmware.transport.sodium import SigningKey

        return SigningKey(self._seed()).public

    def _show(self, done: NodeRenamed) -> None:
        out = self._out
        if out.settings.structured:
            out.document(done)
        else:
            columns = [Column("FORMER"), Column("PLATFORM"), Column("CONFIGURATION"), Column("KEYS")]
            out.table(
                columns, [(done.former, done.platform, done.config_dir, "renamed" if done.keys else "none")]
            )
        out.say(f"start {done.platform}; it has the settings and logs of {done.former}")
        if done.keys:
            out.say(f"each node that takes the new roster forgets the name {done.former}")
        else:
            out.say(
                f"at another node, `swarmctl node remove {done.former}` makes the swarm forget the former"
                " name"
            )


def renamed(text: str, platform: str, source: str) -> str:
    """The text of a node.toml with another platform; comments and all other keys stay.

    Raises: ConfigError when the text is not a valid node.toml, InvalidInput when the key is not found.
    """
    before = parse(text, NodeConfig, source)
    after, count = _LINE.subn(rf'\g<key>"{platform}"', text, count=1)
    # at the top, because below the header of a table it would be a key of that table
    if not count:
        after = f'platform = "{platform}"\n{text}'
    # the pattern may have matched a key of a table or a text; only the parsed result is certain
    if parse(after, NodeConfig, source) != msgspec.structs.replace(before, platform=platform):
        raise InvalidInput(f"{source}: the line of key platform is not clear; expected a change by hand")
    return after
