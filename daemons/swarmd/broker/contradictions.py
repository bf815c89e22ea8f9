"""Reports of members that state in beacons what another member never sent: to the journal, and as the event
`net/denials`."""

from collections.abc import Iterable
from typing import Final

from swarmd.broker.core.action import ReportImpersonation
from swarmd.broker.core.admission.access_filter import UNKNOWN
from swarmd.broker.core.boards.claims import Contradiction
from swarmd.broker.core.broker import BrokerCore
from swarmware.model.names import join
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.transport.security.keys import Keys
from swarmware.types.net import Denial

RELAY: Final = "relay"
"""Verb of a denial: the platform relayed a value that the beacons of its origin contradict, or that its
origin has not signed where every beacon is signed."""

KEY: Final = "key"
"""Verb of a denial: a node signs its beacons with another key than the roster has."""
BEACON: Final = "beacon"
"""Verb of a denial: a member sealed a beacon in the name of another one."""


class ContradictionReports:
    """Names the relays of contradicted values, each with each board at a limited rate."""

    def __init__(self, core: BrokerCore, keys: Keys, denials: DenialReporter) -> None:
        self._core = core
        self._keys = keys
        self._denials = denials

    def on_contradictions(self, found: Iterable[Contradiction], now_ns: int) -> None:
        """Reports the relays of these values."""
        roster, nodes = self._keys.roster, self._core.nodes
        roles = {} if roster is None else roster.roles()
        for each in found:
            relay, origin = nodes.platform(each.relay_hw), nodes.platform(each.origin_hw)
            role = roles.get(relay)
            path = join(origin, self._core.board_path(each.origin_hw, each.data_id))
            name = UNKNOWN if role is None else role.name.lower()
            if each.is_unsigned:
                reason = f"a value of {path} without a valid signature of {origin}, relayed by {relay}"
                self._denials.on_denial(Denial(relay, name, RELAY, path, 1, reason), now_ns)
                continue
            # a relay that received the origin itself states two hops
            source = "" if each.hops <= 2 else f", or of a node between it and {origin}"
            reason = f"a value of {path} that {origin} never sent: forged by {relay}{source}"
            self._denials.on_denial(Denial(relay, name, RELAY, path, 1, reason), now_ns)

    def on_impersonation(self, found: ReportImpersonation, now_ns: int) -> None:
        """Reports the addresses of a member that sealed a beacon in the name of another one."""
        victim = self._core.nodes.platform(found.hw)
        if found.hw == self._core.identity.hw:
            victim = self._core.identity.platform
        hosts = " or ".join(map(self._place, found.hosts))
        if found.is_first:
            if self._keys.sign_public_of(victim) is None:
                return  # its first beacon, without its name: no key is known to compare
            reason = (
                f"a beacon of {victim} from {hosts}, signed with a key that the roster does not have for it"
            )
            self._denials.on_denial(Denial(found.hosts[0], UNKNOWN, KEY, "", 1, reason), now_ns)
            return
        reason = (
            f"a beacon in the name of {victim} that {victim} never sent: sealed by a member, from {hosts}"
        )
        self._denials.on_denial(Denial(found.hosts[0], UNKNOWN, BEACON, "", 1, reason), now_ns)

    def _place(self, host: str) -> str:
        """An address, with the platform where it has only one."""
        platforms = self._core.targets.platforms_at(host)
        return f"{host}, the address of {platforms.pop()}" if len(platforms) == 1 else host
