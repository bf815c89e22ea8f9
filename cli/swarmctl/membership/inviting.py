"""`swarmctl keys invite`: makes tokens, and admits nodes that join with them before they expire."""

import asyncio
import os
import time
from pathlib import Path
from typing import Final, Literal

import msgspec

from swarmctl.membership.addresses import host_and_port, own_addresses
from swarmctl.membership.distribution import current_root, hand_over
from swarmctl.membership.listener import JoinListener, WrittenAnswer, listening_socket
from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.root_folder import RootFolder
from swarmctl.membership.seeds import unicast_port
from swarmctl.terminal.output import Output
from swarmctl.terminal.quantities import spoken
from swarmware.errors import Denied, InvalidInput, NoAnswer, NotFound, Partial, SwarmError
from swarmware.model.access import Role
from swarmware.model.clock import utc_ns
from swarmware.model.names import check_platform
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.enrolment.inviter import Admission, Invitation, Inviter
from swarmware.transport.enrolment.messages import JoinFile, seal_file
from swarmware.transport.enrolment.token import SECRET_BYTES, JoinToken, root_digest
from swarmware.transport.security.keys import SEED_BYTES
from swarmware.transport.security.root import Candidate, Root, candidate
from swarmware.transport.sodium import NONCE_BYTES

VALID_MAX_S: Final = 30 * 86400.0
"""Maximum validity of a token."""


class InvitedNode(msgspec.Struct, frozen=True):
    """The invitation of a platform, and its outcome."""

    platform: str
    state: Literal["invited", "joined", "expired", "open"]
    """Outcome of the invitation; `open` if the swarm has no keys and needs no invitation."""
    role: str
    command: str
    """Command to type on the node."""
    token: str
    expires_utc_ns: int
    address: str = ""
    """Address of the node that joined."""


class InvitationPlan(msgspec.Struct, frozen=True):
    """Options of an invitation."""

    platforms: tuple[str, ...]
    role: str
    valid_s: float
    address: str = ""
    """HOST or HOST:PORT for the tokens, or "" for the addresses of this computer."""
    file: str = ""
    """File for the credentials, or "" to invite over the network."""


def invite_nodes(out: Output, root_dir: Path | None, plan: InvitationPlan) -> None:
    """Invites platforms, and prints the command that each node needs.

    Raises: NotFound without a root; InvalidInput for a name, role or time; Partial when some invitations
    expired, NoAnswer when all did; Conflict, Denied, OSError.
    """
    # before anything is read or locked: a typing error should not depend on the state of the root
    check_plan(plan)
    folder = RootFolder(root_dir)
    root = current_root(out, folder)
    for platform in plan.platforms:
        if root.roster.find(platform) is not None:
            out.warn(f"{platform} is a member already: the node that joins with this token takes its place")
    if plan.file:
        _to_file(out, folder, plan)
    else:
        asyncio.run(_Admission(out, folder, root, plan).run())


def check_plan(plan: InvitationPlan) -> None:
    """Check the options of an invitation. Raises: InvalidInput, ConfigError."""
    for platform in plan.platforms:
        check_platform(platform)
    if len(set(plan.platforms)) != len(plan.platforms):
        raise InvalidInput("platforms: one is named twice; expected each once")
    Role.named(plan.role)
    if not 0 < plan.valid_s <= VALID_MAX_S:
        raise InvalidInput(
            f"--valid: {plan.valid_s:g} s; expected more than 0 and {VALID_MAX_S / 86400:g}d at most"
        )
    if plan.file and len(plan.platforms) != 1:
        raise InvalidInput(f"--file: {len(plan.platforms)} platforms; expected one for each file")


class _Admission:
    """Admits the nodes of the open invitations."""

    def __init__(self, out: Output, folder: RootFolder, root: Root, plan: InvitationPlan) -> None:
        self._out = out
        self._folder = folder
        host, port = host_and_port(plan.address) if plan.address else ("", 0)
        # bound before the tokens are made, because they contain the port that was free
        self._bound = listening_socket(port)
        hosts, port = (host,) if host else own_addresses(), self._bound.getsockname()[1]
        now_ns, utc_s = time.monotonic_ns(), utc_ns() // 1_000_000_000
        invitations = [
            Invitation(
                platform,
                plan.role,
                new_token(root, utc_s + round(plan.valid_s), hosts, port),
                now_ns + round(plan.valid_s * 1e9),
            )
            for platform in plan.platforms
        ]
        self._invitations = invitations
        self._valid_s = plan.valid_s
        self._broker_port = _broker_port(out)
        self._core = Inviter(invitations, folder.refused(utc_s), lambda: os.urandom(NONCE_BYTES), now_ns)
        self._changed = asyncio.Event()
        self._turn = asyncio.Lock()
        self._joined: list[str] = []

    async def run(self) -> None:
        """Serves until each invitation has expired or its node has confirmed that it has its keys.

        Raises: Partial when some expired, NoAnswer when all did.
        """
        # recorded before the first connection, so that a later inviter knows these tokens even after a kill
        self._folder.record(*self._invitations)
        listener = JoinListener(self._permit, self._answer, self._take_receipt)
        async with asyncio.TaskGroup() as tasks:
            serving = tasks.create_task(listener.serve(self._bound), name="join listener")
            for one in self._invitations:
                self._show(one, "invited")
            token = self._invitations[0].token
            self._out.say(
                f"listening on TCP port {token.port} ({', '.join(token.hosts)}) for {spoken(self._valid_s)};"
                " Ctrl-C ends it, nodes that have joined stay"
            )
            await self._wait()
            serving.cancel()
        missing = [one.platform for one in self._invitations if one.platform not in self._joined]
        if missing:
            text = f"{', '.join(missing)}: did not join within {spoken(self._valid_s)}"
            raise (Partial if self._joined else NoAnswer)(text)

    async def _wait(self) -> None:
        while (deadline_ns := self._core.deadline_ns()) is not None:
            try:
                async with asyncio.timeout(max(0.0, (deadline_ns - time.monotonic_ns()) / 1e9)):
                    await self._changed.wait()
                    self._changed.clear()
            except TimeoutError:
                now_ns = time.monotonic_ns()
                for one in self._core.expire(now_ns):
                    self._show(one, "expired")
                for one in self._core.expire_receipts(now_ns):
                    self._out.warn(
                        f"{one.platform} has not confirmed that it has its keys;"
                        f" if its `keys join` failed, invite {one.platform} again"
                    )

    def _permit(self, address: str) -> bool:
        return self._core.on_connection(address, time.monotonic_ns())

    def _take_receipt(self, data: bytes) -> None:
        if (found := self._core.on_receipt(data)) is not None:
            self._out.detail(f"{found.platform} has its keys")
            self._changed.set()

    async def _answer(self, data: bytes, address: str) -> WrittenAnswer | None:
        async with self._turn:  # one admission at a time, because each changes the root's roster
            found = self._core.on_request(data, utc_ns(), time.monotonic_ns())
            if not isinstance(found, Admission):
                self._out.detail(f"a request of {address} was refused or not readable")
                return None if found is None else WrittenAnswer(found)
            try:
                root = await self._admit(found)
            except (SwarmError, OSError) as error:
                self._out.warn(f"{found.request.platform} at {address} could not be admitted: {error}")
                return WrittenAnswer(self._core.failed(found, str(error), utc_ns()))
            answer = self._core.admitted(
                found, root.public, root.signed, utc_ns(), time.monotonic_ns(), self._broker_port
            )
        if not found.repeated:
            self._joined.append(found.request.platform)
            self._show(found.invitation, "joined", address)
        self._changed.set()
        return WrittenAnswer(answer, confirmed=True)

    async def _admit(self, admission: Admission) -> Root:
        request, invitation = admission.request, admission.invitation
        with self._folder.locked():
            root = self._folder.load()  # another command may have changed it since the invitation
            if not admission.repeated:
                root.admit(Candidate(request.platform, invitation.role, request.sign_public, request.proof))
        if not admission.repeated:
            self._folder.record(invitation, used=True)
            await hand_over(self._out, root)
        return root

    def _show(
        self, one: Invitation, state: Literal["invited", "joined", "expired"], address: str = ""
    ) -> None:
        show_invited(self._out, one, state, address)


def _broker_port(out: Output) -> int:
    """UDP port of the broker on this computer, which new members get as a seed, or 0 without one."""
    try:
        return unicast_port(NodeKeys.find(out.settings))
    except NotFound:
        return 0


def show_invited(
    out: Output,
    one: Invitation,
    state: Literal["invited", "joined", "expired"],
    address: str = "",
    file: str = "",
) -> None:
    """Prints an invitation, or its outcome."""
    text = one.token.text()
    command = f"swarmctl keys join {text}" + (f" --file {file}" if file else "")
    if out.settings.structured:
        expires_utc_ns = one.token.expires_utc_s * 1_000_000_000
        out.line(InvitedNode(one.platform, state, one.role, command, text, expires_utc_ns, address))
    elif state == "invited":
        out.say(f"on {one.platform}, as {one.role}:")
        out.verbatim(command)
    elif state == "joined":
        out.say(f"{one.platform} joined from {address}")
    else:
        out.say(f"the invitation of {one.platform} has expired")


def _to_file(out: Output, folder: RootFolder, plan: InvitationPlan) -> None:
    """Admits a platform with credentials that are made here, and writes them to a file."""
    (platform,) = plan.platforms
    path, seed = Path(plan.file), os.urandom(SEED_BYTES)
    # before the roster changes, because a member without its file could never join
    if not os.access(path.parent, os.W_OK):
        raise Denied(f"{path.parent}: cannot be written; expected an existing folder of this user")
    utc_s = utc_ns() // 1_000_000_000
    with folder.locked():
        root = folder.load()
        token = new_token(root, utc_s + round(plan.valid_s), (), 0)
        signed = root.admit(candidate(platform, plan.role, seed, root.public))
        content = JoinFile(platform, seed, root.public, signed)
        replace_file(path, seal_file(token, os.urandom(NONCE_BYTES), content), mode=0o600)
    invitation = Invitation(platform, plan.role, token, 0)
    admitted = root.roster.find(platform)
    folder.record(invitation, serial=0 if admitted is None else admitted.serial)
    asyncio.run(hand_over(out, root))
    show_invited(out, invitation, "invited", file=plan.file)
    out.say(
        f"bring {path} to {platform}, and the line by another way: together they are its identity;"
        f" valid {spoken(plan.valid_s)}, by the clock of {platform}"
    )


def new_token(root: Root, expires_utc_s: int, hosts: tuple[str, ...], port: int) -> JoinToken:
    """A token with a new secret."""
    return JoinToken(os.urandom(SECRET_BYTES), root_digest(root.public), expires_utc_s, hosts, port)
