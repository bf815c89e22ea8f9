"""The roster of this node while it runs: stored, published, handed over by operators, and put into effect."""

import asyncio
import logging
from pathlib import Path
from typing import Final

from swarmd.broker.exchange.beacon_transport import BeaconTransport
from swarmd.broker.exchange.frame_gateway import FrameGateway
from swarmware.errors import Conflict, Denied, NoAnswer, NotFound
from swarmware.node.node import Node
from swarmware.service.service import Service
from swarmware.transport.enrolment.token import fingerprint
from swarmware.transport.security.keys import Keys, StoredRoster
from swarmware.transport.security.roster import RosterChange, parse_roster
from swarmware.types.net import RosterMemberState, RosterState, SignedRoster
from swarmware.types.register import PlatformRemoval, PlatformRemoved

FORGET: Final = ("sys/tree/forget", "sys/register/forget")
"""Where this node forgets a platform."""
FORGET_S: Final = 1.0
"""Pause before a service is asked again to forget a name, while it still has a route to it."""
FORGET_TRIES: Final = 30
log = logging.getLogger("swarm.broker")


def keys_folder(node: Node) -> Path:
    """The folder of a node's keys."""
    return node.config_dir / node.config.keys_dir  # an absolute path stays unchanged


class Membership:
    """Carries out changes of the roster."""

    def __init__(
        self, service: Service, keys: Keys, transport: BeaconTransport, gateway: FrameGateway
    ) -> None:
        self._module = service.module
        self._health = service.health
        self._keys = keys
        self._writing = asyncio.Lock()
        """One roster after the other: the newest is the last one."""
        self._folder = keys_folder(service.module.node)
        self._transport = transport
        self._gateway = gateway
        self._board = service.module.writer(
            "net/roster", RosterState, link="request", description="Members of the swarm"
        )
        self._publish(self.state())

    def apply(self, change: RosterChange) -> None:
        """Puts a new roster into effect; what the core removes follows as actions of its own."""
        roster = change.roster
        self._transport.on_roster(change)
        self._gateway.on_roster(change)
        self._module.start(self._store(self._keys.stored(), self.state()), "store the roster")
        for former, present in change.renamed.items():
            log.info("%s is %s now: the same key", former, present)
            self._module.start(self._forget(former), f"forget {former}")
        log.info(
            "roster %d: %d members%s%s%s%s",
            roster.version,
            len(roster.valid()),
            _named("new", [member.platform for member in change.came]),
            _named("revoked or replaced", [member.platform for member in change.gone]),
            _named("another role", [f"{each.platform} {each.role}" for each in change.changed]),
            f"; group key {roster.key_epoch}" if change.rotated else "",
        )

    async def _store(self, stored: StoredRoster, state: RosterState) -> None:
        """Writes the roster, which takes as long as the disk, then publishes that it is in force."""
        async with self._writing:
            try:
                await asyncio.to_thread(stored.write, self._folder)
            except OSError as error:
                log.error(
                    "%s: the roster cannot be stored: %s; after a restart this node begins with the former"
                    " one: let the user of the daemons write the folder",
                    self._folder,
                    error.strerror,
                )
                self._health.report(
                    "roster", "unstored", level="warn", detail=f"{self._folder}: {error.strerror}"
                )
            self._publish(state)

    async def _forget(self, former: str) -> None:
        """Makes the other services of this node forget the former name of a member."""
        for path in FORGET:
            for _ in range(FORGET_TRIES):
                try:
                    await self._module.request(path, PlatformRemoval(former), PlatformRemoved)
                except (Conflict, NoAnswer):  # its route ends with the link
                    await asyncio.sleep(FORGET_S)
                except NotFound:  # the node has no such service
                    break
                else:
                    break

    def serve(self, request: SignedRoster, _meta: object) -> RosterState:
        """Takes the roster of an operator, whose right is the root's signature; returns the one in force.

        Raises: Conflict when a newer one is in force, ConfigError, Denied.
        """
        if not request.text:
            return self.state()
        if self._keys.roster is None:
            raise Denied(f"{self._keys.platform} has no keys: it takes no roster")
        version = parse_roster(request.text, self._keys.root_public, "roster").version
        if version < self._keys.roster.version:
            raise Conflict(f"roster {version} is older than {self._keys.roster.version}, which is in force")
        self._gateway.take_roster(request.text)
        return self.state()

    def state(self) -> RosterState:
        """The roster in force, without keys."""
        roster = self._keys.roster
        if roster is None:
            return RosterState()
        return RosterState(
            roster.version,
            roster.key_epoch,
            roster.swarm,
            fingerprint(self._keys.root_public),
            tuple(
                RosterMemberState(each.platform, each.role, each.serial, each.serial in roster.revoked)
                for each in roster.members
            ),
            self._keys.is_revoked,
        )

    def _publish(self, state: RosterState) -> None:
        self._board.write(state)
        if not state.revoked_self:
            self._health.report("membership", description="This node is a member of the swarm")
            return
        platform, version = self._keys.platform, state.version
        problem = f"{platform} was revoked by roster {version}"
        if any(each.platform == platform and not each.revoked for each in state.members):
            problem = (
                f"roster {version} has another key for {platform}: these keys were replaced (another computer"
                " has joined with this name, or they are a former copy)"
            )
        log.error("%s: no other node takes what this node sends", problem)
        self._health.report(
            "membership",
            "revoked",
            level="error",
            detail=f"{problem}; admit it again, then restart the node",
            description="This node is a member of the swarm",
        )


def _named(what: str, names: list[str]) -> str:
    return f"; {what}: {', '.join(names)}" if names else ""
