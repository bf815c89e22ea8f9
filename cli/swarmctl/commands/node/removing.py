"""`swarmctl node remove`: ends the membership of platforms; the nodes that run forget them."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.membership.changing import signed, warn_late
from swarmctl.membership.distribution import current_root
from swarmctl.membership.hosts import read_hosts
from swarmctl.membership.hosts_file import remove_hosts
from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.root_folder import RootFolder
from swarmctl.resources.restart import is_armed
from swarmctl.session.session import Session, connect
from swarmctl.terminal.confirmation import JointConfirmation, confirm
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.errors import Conflict, Denied, InvalidInput, NoAnswer, NotFound, Partial, SwarmError
from swarmware.model import names
from swarmware.types.health import FaultClear, FaultList
from swarmware.types.mission import INACTIVE, MissionStatus
from swarmware.types.register import PlatformRemoval, PlatformRemoved
from swarmware.types.rpc import Empty

POLL_S: Final = 0.25
"""Period of the requests to a node that still has a route to the removed one."""
FORGET: Final = ("sys/tree/forget", "sys/register/forget")


class NodesRemoved(msgspec.Struct, frozen=True):
    """Platforms that were removed from the swarm."""

    platforms: list[str]
    revoked: list[str]
    """Platforms whose keys were revoked."""
    forgotten: list[str]
    """Nodes that have forgotten the platforms."""
    missing: dict[str, str]
    """Nodes that have not forgotten them, with the reason; a repeated call asks them again."""
    hosts: list[str]
    """Platforms that were removed from the file of hosts."""


class Removal:
    """The removal of some platforms."""

    def __init__(
        self, out: Output, platforms: tuple[str, ...], root_dir: Path | None, hosts_file: Path | None
    ) -> None:
        self._out = out
        self._platforms = tuple(dict.fromkeys(map(names.check_platform, platforms)))
        self._folder = RootFolder(root_dir)
        self._file = hosts_file
        self._has_keys = NodeKeys.find(out.settings).has_identity
        self._members: tuple[str, ...] = ()

    def run(self, wait_s: float, *, yes: bool, force: bool) -> None:
        """Removes the platforms and prints the result.

        Raises: NotFound for an unknown platform; Conflict for a platform in a mission, or running in a swarm
        without keys; Denied for an armed one unless `force`; Partial when a node has not forgotten them; as
        `confirm`, `signed` and `remove_hosts`.
        """
        if self._has_keys:
            roster = current_root(self._out, self._folder).roster
            self._members = tuple(one for one in self._platforms if roster.find(one) is not None)
        # a platform that never joined is known from the file alone
        listed = {host.name for host in read_hosts(self._file)} if self._file is not None else set[str]()
        asyncio.run(self._check(listed, force=force))
        text = "revoke, and forget everywhere" if self._members else "forget everywhere"
        confirm(yes, f"remove {', '.join(self._platforms)}: {text}")
        # before the revocation: the file can refuse, and a revocation cannot be taken back
        hosts = remove_hosts(self._file, self._platforms) if self._file is not None else []
        if self._members:
            members = self._members
            # before the others forget: a member that still has its keys would be learned again
            warn_late(self._out, signed(self._out, self._folder, lambda root: root.revoke(*members), members))
        forgotten, missing = asyncio.run(self._forget(wait_s))
        self._show(NodesRemoved(list(self._platforms), list(self._members), forgotten, missing, hosts))
        if missing:
            raise Partial(f"{', '.join(missing)}: not forgotten there; a repeated call asks again")

    async def _check(self, listed: set[str], *, force: bool) -> None:
        async with connect(self._out.settings, self._out) as session:
            known = {*await session.platforms(), *self._members, *listed}
            reached = {route.platform for route in (await session.routes()).routes}
            for platform in self._platforms:
                if platform == session.here:
                    raise InvalidInput(
                        f"{platform}: the node on this computer; expected another member to remove it"
                    )
                if platform not in known:
                    there = ", ".join(sorted(known, key=names.natural))
                    raise NotFound(f"node {platform!r}: not known to {session.here}; expected one of {there}")
                # an unreachable member can be removed, as it cannot be asked
                if platform in reached:
                    await self._check_idle(
                        session.at(platform, self._out, JointConfirmation([platform])), force=force
                    )

    async def _check_idle(self, session: Session, *, force: bool) -> None:
        platform = session.platform
        # without a revocation a running node would appear again at once
        if platform not in self._members:
            raise Conflict(f"{platform}: it runs, and has no key to revoke; expected it to be ended before")
        if force:
            return
        try:
            status = await session.ask("sys/mission/status", Empty(), MissionStatus)
            armed = await is_armed(session)
        except NoAnswer as error:
            raise Denied(f"{platform}: it may fly, as it is reachable ({error}); expected --force") from error
        except NotFound:
            return  # no mission service
        if status.state.state not in INACTIVE:
            raise Conflict(
                f"{platform}: mission {status.state.mission} {status.state.state}; expected its end"
                f" (`swarmctl node drain {platform}`), or --force"
            )
        if armed:
            raise Denied(f"{platform} is armed; expected a disarmed vehicle, or --force")

    async def _forget(self, wait_s: float) -> tuple[list[str], dict[str, str]]:
        async with connect(self._out.settings, self._out) as session:
            routes = (await session.routes()).routes
            # each computer of a platform has its own tree and register
            left = {route.name for route in routes if route.platform not in self._platforms}
            nodes = sorted({str(session.module.node.address), *left}, key=names.natural)
            errors = await asyncio.gather(*(self._forget_at(session, node, wait_s) for node in nodes))
        missing = {node: str(error) for node, error in zip(nodes, errors, strict=True) if error is not None}
        return [node for node in nodes if node not in missing], missing

    async def _forget_at(self, session: Session, node: str, wait_s: float) -> SwarmError | None:
        """The error that remains after the time, or None if the node has forgotten the platform."""
        error: SwarmError | None = None
        try:
            async with asyncio.timeout(wait_s):
                async for _ in session.module.every(POLL_S):
                    try:
                        await forget_at(session, node, self._platforms)
                    except (Conflict, NoAnswer) as why:  # a route that ends with the roster, or a busy node
                        error = why
                    except SwarmError as why:
                        return why
                    else:
                        return None
        except TimeoutError:
            pass
        return error or NoAnswer(f"{node}: no answer within {wait_s:g} s")

    def _show(self, done: NodesRemoved) -> None:
        if self._out.settings.structured:
            self._out.document(done)
            return
        rows = [(node, "yes", None) for node in done.forgotten]
        columns = [Column("NODE"), Column("FORGOTTEN"), Column("REASON")]
        self._out.table(columns, [*rows, *((node, "no", why) for node, why in done.missing.items())])


async def forget_at(session: Session, node: str, platforms: Sequence[str]) -> None:
    """Makes one node forget platforms: structure, last values, applications, and the fault of their loss.

    Raises: Conflict while one is reachable there; as `Module.request`.
    """
    for platform in platforms:
        for path in FORGET:
            await _asked(session, names.join(node, path), PlatformRemoval(platform), PlatformRemoved)
        clear = FaultClear(f"platform/{platform}")
        await _asked(session, names.join(node, "sys/health/clear"), clear, FaultList)


async def _asked(session: Session, path: str, value: msgspec.Struct, reply: type[msgspec.Struct]) -> None:
    try:
        await session.module.request(path, value, reply, timeout_s=session.settings.timeout_s)
    except NotFound as error:
        session.out.detail(f"{path}: {error}")  # the node has no such service
