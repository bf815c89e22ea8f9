"""The roster of this node while it runs: stored, published, handed over by operators, and put into effect."""

import logging
from pathlib import Path

from swarmd.broker.beacon_transport import BeaconTransport
from swarmd.broker.frame_gateway import FrameGateway
from swarmware.errors import Conflict, Denied
from swarmware.node.node import Node
from swarmware.service.service import Service
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import fingerprint
from swarmware.transport.security.roster import RosterChange, parse_roster
from swarmware.types.net import RosterMemberState, RosterState, SignedRoster

log = logging.getLogger("swarm.broker")


def keys_folder(node: Node) -> Path:
    """The folder of a node's keys."""
    return node.config_dir / node.config.keys_dir  # an absolute path stays unchanged


class Membership:
    """Carries out changes of the roster."""

    def __init__(
        self, service: Service, keys: Keys, transport: BeaconTransport, gateway: FrameGateway
    ) -> None:
        self._health = service.health
        self._keys = keys
        self._folder = keys_folder(service.module.node)
        self._transport = transport
        self._gateway = gateway
        self._board = service.module.writer(
            "net/roster", RosterState, link="request", description="Members of the swarm"
        )
        self._publish()

    def apply(self, change: RosterChange) -> None:
        """Puts a new roster into effect; what the core removes follows as actions of its own."""
        roster = change.roster
        self._transport.on_roster(change)
        self._gateway.on_roster(change)
        try:
            self._keys.save(self._folder)
        except OSError as error:
            log.error(
                "%s: the roster cannot be stored: %s; after a restart this node begins with the former one:"
                " let the user of the daemons write the folder",
                self._folder,
                error.strerror,
            )
            self._health.report(
                "roster", "unstored", level="warn", detail=f"{self._folder}: {error.strerror}"
            )
        log.info(
            "roster %d: %d members%s%s%s%s",
            roster.version,
            len(roster.valid()),
            _named("new", [member.platform for member in change.came]),
            _named("revoked or replaced", [member.platform for member in change.gone]),
            _named("another role", [f"{each.platform} {each.role}" for each in change.changed]),
            f"; group key {roster.key_epoch}" if change.rotated else "",
        )
        self._publish()

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

    def _publish(self) -> None:
        self._board.write(self.state())
        if not self._keys.is_revoked:
            self._health.report("membership", description="This node is a member of the swarm")
            return
        platform, version = self._keys.platform, self.state().version
        log.error("%s was revoked by roster %d: no other node takes what it sends", platform, version)
        self._health.report(
            "membership",
            "revoked",
            level="error",
            detail=f"{platform} was revoked by roster {version}; admit it again, then restart the node",
            description="This node is a member of the swarm",
        )


def _named(what: str, names: list[str]) -> str:
    return f"; {what}: {', '.join(names)}" if names else ""
