"""Reports of members that state in beacons what another member never sent: to the journal, and as the event
`net/denials`."""

from collections.abc import Iterable
from typing import Final

from swarmd.broker.core.broker import BrokerCore
from swarmd.broker.core.membership.access_filter import UNKNOWN
from swarmd.broker.core.membership.sessions import ReportImpersonation
from swarmd.broker.core.membership.signatures.signature_checks import UnsignedValue
from swarmware.model.names import join
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.transport.security.keys import Keys
from swarmware.types.net import Denial

RELAY: Final = "relay"
"""Verb of a denial: the platform relayed a value that its origin has not signed."""
KEY: Final = "key"
"""Verb of a denial: a node signs its beacons with another key than the roster has."""
BEACON: Final = "beacon"
"""Verb of a denial: a member sealed a beacon in the name of another one."""


class ForgeryReports:
    """Names who sends what another member never sent, each with each board at a limited rate."""

    def __init__(self, core: BrokerCore, keys: Keys, denials: DenialReporter) -> None:
        self._core = core
        self._keys = keys
        self._denials = denials

    def on_values(self, found: Iterable[UnsignedValue], now_ns: int) -> None:
        """Reports the relays of these values."""
        roster, nodes = self._keys.roster, self._core.nodes
        roles = {} if roster is None else roster.roles()
        for each in found:
            relay, origin = nodes.platform(each.relay_hw), nodes.platform(each.origin_hw)
            role = roles.get(relay)
            path = join(origin, self._core.board_path(each.origin_hw, each.data_id))
            name = UNKNOWN if role is None else role.name.lower()
            reason = f"a value of {path} without a valid signature of {origin}, relayed by {relay}"
            self._denials.on_denial(Denial(relay, name, RELAY, path, 1, reason), now_ns)

    def on_impersonation(self, found: ReportImpersonation, now_ns: int) -> None:
        """Reports the address of a member that sealed a beacon in the name of another one."""
        victim = self._core.nodes.platform(found.hw)
        if found.hw == self._core.identity.hw:
            victim = self._core.identity.platform
        place = self._place(found.host)
        if found.is_other_key:
            verb = KEY
            reason = (
                f"a beacon of {victim} from {place}, signed with a key that the roster does not have for it"
            )
        else:
            verb = BEACON
            reason = (
                f"a beacon in the name of {victim} that {victim} never sent: sealed by a member, from {place}"
            )
        self._denials.on_denial(Denial(found.host, UNKNOWN, verb, "", 1, reason), now_ns)

    def _place(self, host: str) -> str:
        """An address, with the platform where it has only one."""
        platforms = self._core.targets.platforms_at(host)
        return f"{host}, the address of {platforms.pop()}" if len(platforms) == 1 else host
