"""Sends and receives beacons over UDP: sealed, counted, by multicast and by unicast."""

import asyncio
import logging
import struct
from collections.abc import Callable
from typing import Final

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core import beacon_codec as codec
from swarmd.broker.core import session_checks
from swarmd.broker.core.beacon import Beacon, Header
from swarmd.broker.core.beacon_protocol import BeaconProtocol, OutgoingBeacon, ReceivedBeacon
from swarmd.broker.core.datagram_limiter import DatagramLimiter
from swarmd.broker.core.sessions import ACCEPTED, SessionOutcome, Sessions
from swarmd.broker.core.topology import LinkState
from swarmd.broker.core.traffic import EVERYBODY, Counters
from swarmd.broker.links.udp import LOOPBACK, Address, Udp, resolve
from swarmware.errors import SwarmError, WireError
from swarmware.model.clock import Clock
from swarmware.model.names import hardware_id
from swarmware.transport.security import Keys, Opener, Refusal, Sealer

UNRETURNED_MAX: Final = 20
"""Own beacons without loopback, and without any other node's, after which multicast counts as missing."""
PROBE_EVERY: Final = 20
"""Without multicast, every twentieth beacon still probes the group."""
CLAIMANTS_MAX: Final = 16
CLAIMANT_NS: Final = 3_000_000_000
SEEDS_S: Final = 30.0
"""Period in which the names of seeds are resolved again."""
_UNKNOWN: Final = "?"
FAULTS: Final = (
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
    struct.error,
    SwarmError,
)
"""Exceptions of a defect of this program on input from outside: they cost one datagram, not the broker."""
FAULTS_LOGGED: Final = 5
"""Faults that are logged with their traceback; the others are only counted."""

log = logging.getLogger("swarm.broker")


class BeaconTransport:
    """Seals and sends the beacons that the protocol composes; opens received ones and passes them to it."""

    def __init__(
        self,
        config: Config,
        keys: Keys,
        session: int,
        clock: Clock,
        protocol: BeaconProtocol,
        counters: Counters,
        sessions: Sessions,
        on_received: Callable[[ReceivedBeacon], None],
        on_outcome: Callable[[int, SessionOutcome], None],
        keep_period: Callable[[int], None],
    ) -> None:
        """Raises: ConfigError when an address or port cannot be used."""
        self._sessions = sessions
        self._on_outcome = on_outcome
        self._keep_period = keep_period
        self._claimants: dict[Address, int] = {}
        """Unicast senders without an accepted session, and until when beacons are sent to them."""
        self.by_unicast: set[int] = set()
        """Neighbours whose newest datagram came by unicast."""
        self._config = config
        self._clock = clock
        self._protocol = protocol
        self._counters = counters
        self._on_received = on_received
        self._hardware = protocol.identity.hw
        self._epoch = keys.group.epoch
        self._session = session
        self._sealer = Sealer(keys.group, self._hardware, session)
        self._opener = Opener(keys.group)
        members = None if keys.roster is None else keys.roster.valid()
        self._limiter = DatagramLimiter(
            None if members is None else {hardware_id(member.platform) for member in members}
        )
        self._hear = frozenset(hardware_id(name) for name in config.hear_only) or None
        self._unreturned = 0
        self._faults = 0
        self._seeds: dict[str, Address] = {}
        self._loop = asyncio.get_running_loop()
        self._udp = Udp(config, self._loop, clock, self._on_datagram)

    @property
    def port(self) -> int:
        """Our own UDP port."""
        return self._udp.port

    @property
    def has_checks(self) -> bool:
        """Whether a question or an answer about sessions waits for the next beacon."""
        return bool(self._sessions.waiting)

    async def look_up_seeds(self) -> None:
        """Resolves the names of the seeds periodically until it is cancelled."""
        own = {(host, self._udp.port) for host in (LOOPBACK, self._config.bind_address)}
        while True:
            for seed in self._config.seeds:
                address = await resolve(seed, self._loop)
                if address is not None and address not in own:
                    self._seeds[seed] = address
            await asyncio.sleep(SEEDS_S)

    # sending

    def send_beacon(self, now_ns: int) -> None:
        """Composes and sends the next beacon; one that cannot be composed is counted and skipped."""
        try:
            self._protocol.reserved_bytes = session_checks.body_bytes(self._sessions.waiting)
            outgoing = self._protocol.compose(now_ns)
            if outgoing.declared_period_ns:
                self._keep_period(outgoing.declared_period_ns)
            if self._sessions.waiting:
                beacon = msgspec.structs.replace(outgoing.beacon, checks=self._sessions.due(now_ns))
                outgoing = msgspec.structs.replace(outgoing, beacon=beacon)
            self._send(outgoing, now_ns)
        except FAULTS:
            self._counters.failed_ticks += 1
            self._failed("a beacon could not be composed")

    def _failed(self, what: str) -> None:
        self._faults += 1
        if self._faults <= FAULTS_LOGGED:
            log.exception("%s; please report this", what)

    def _send(self, outgoing: OutgoingBeacon, composed_ns: int) -> None:
        """Sends a beacon, stamped as late as possible; `composed_ns`: instant to which its ages and echoes
        refer."""
        beacon, sequence = outgoing.beacon, outgoing.sequence
        body = bytearray(codec.encode(beacon))
        tx_ns = self._clock.now_ns()
        if beacon.hello is not None and tx_ns // 1000 >> 32 != beacon.hello.clock_high:
            hello = msgspec.structs.replace(beacon.hello, clock_high=tx_ns // 1000 >> 32)
            body = bytearray(codec.encode(msgspec.structs.replace(beacon, hello=hello)))
        codec.shift_echoes(body, tx_ns // 1000 - composed_ns // 1000)
        clear = codec.encode_header(
            Header(
                self._epoch,
                self._hardware,
                sequence,
                tx_ns // 1000 & 0xFFFF_FFFF,
                self._session if outgoing.with_session else None,
            )
        )
        data = clear + self._sealer.seal(sequence, clear, bytes(body))
        if self._udp.has_group and (self._unreturned < UNRETURNED_MAX or sequence % PROBE_EVERY == 0):
            self._to_group(data)
        for address in self._single_nodes():
            if self._udp.send(data, address):
                self._counters.datagram_sent(len(data), f"{address[0]}:{address[1]}")
        self._protocol.sent(sequence, tx_ns, len(data))

    def _to_group(self, data: bytes) -> None:
        if self._udp.send_to_all(data):
            self._counters.datagram_sent(len(data), EVERYBODY)
        self._unreturned += 1
        if self._unreturned == UNRETURNED_MAX:
            log.warning(
                "multicast does not work here: only seeds and senders of unicast datagrams are reached"
            )

    def _single_nodes(self) -> set[Address]:
        """Addresses of seeds and neighbours that multicast does not reach."""
        if not self._seeds and not self.by_unicast and not self._claimants:
            return set()
        single: set[Address] = set()
        by_group: set[Address] = set()
        for neighbour in self._protocol.topology.neighbours.all():
            if neighbour.state is LinkState.DOWN:
                continue
            if neighbour.hw in self.by_unicast:
                single.add(neighbour.address)
            else:
                by_group.add(neighbour.address)
        single.update(address for address in self._seeds.values() if address not in by_group)
        now_ns = self._clock.now_ns()
        self._claimants = {address: end_ns for address, end_ns in self._claimants.items() if end_ns > now_ns}
        single.update(self._claimants)
        return single

    # receiving

    def receive(self) -> None:
        """Reads the datagrams that wait in the sockets, without the delay of batching."""
        self._udp.receive()
        self._udp.set_min_period(self._protocol.topology.neighbours.usual_period_ns())

    def _on_datagram(self, data: bytes, address: Address, rx_mono_ns: int, by_multicast: bool) -> None:
        sender_hw = codec.sender_of(data)
        if sender_hw == self._hardware and self._is_own(data):
            self._unreturned = 0  # multicast loops datagrams back
            return
        if self._hear is not None and sender_hw not in self._hear:
            self._counters.refused.unheard += 1
            return
        if not self._limiter.may_open(address, sender_hw, rx_mono_ns):
            self._counters.refused.flooded += 1
            return
        try:
            header, start = codec.decode_header(data)
            opened = self._opener.open(
                header.epoch, sender_hw, header.session, header.sequence, data[:start], data[start:]
            )
            if isinstance(opened, Refusal):
                if opened is not Refusal.REPLAYED:
                    self._limiter.bad(address)
                self._refused(sender_hw, opened, len(data))
                return
            beacon = codec.decode(opened.body)
        except WireError as error:
            self._limiter.bad(address)
            self._counters.datagram_received(len(data), _UNKNOWN)
            self._counters.refused.malformed += 1
            log.debug("datagram from %s:%d: %s", *address, error)
            return
        try:
            rx_ns = self._clock.from_mono_ns(rx_mono_ns)
            if not self._is_accepted(sender_hw, opened.session, beacon, address, by_multicast, rx_ns):
                self._counters.datagram_received(len(data), _UNKNOWN)
                return
            self._limiter.good(address)
            header.session = opened.session
            self._take(header, beacon, address, rx_ns, by_multicast, len(data))
        except FAULTS:
            self._counters.refused.failed += 1
            self._failed("a datagram could not be processed")

    def _take(
        self,
        header: Header,
        beacon: Beacon,
        address: Address,
        rx_ns: int,
        by_multicast: bool,
        size: int,
    ) -> None:
        received = self._protocol.on_datagram(header, beacon, address, rx_ns)
        if received is None:
            self._counters.datagram_received(size, _UNKNOWN)
            return
        sender_hw = header.sender_hw
        self._counters.datagram_received(size, self._protocol.nodes.platform(sender_hw))
        if by_multicast:
            self._unreturned = 0
            self.by_unicast.discard(sender_hw)
        else:
            self.by_unicast.add(sender_hw)
        self._on_received(received)

    def _is_own(self, data: bytes) -> bool:
        """Whether a datagram is an own one that was looped back; one without a session counts as own."""
        try:
            session = codec.decode_header(data)[0].session
        except WireError:
            return True
        return session in (None, self._session)

    def _is_accepted(
        self, hw: int, session: int, beacon: Beacon, address: Address, by_multicast: bool, now_ns: int
    ) -> bool:
        outcome = self._sessions.on_datagram(hw, session, beacon.checks, now_ns)
        if outcome is ACCEPTED:
            return True
        if outcome.adopted:
            self._opener.adopt(hw, session)
        if outcome.soon or outcome.duplicate:
            self._on_outcome(hw, outcome)
        if not outcome.accepted:
            refused = self._counters.refused
            present = self._sessions.present(hw)
            if present is not None and session < present:
                refused.old_session += 1
            else:
                refused.unproven += 1
            if not by_multicast and len(self._claimants) < CLAIMANTS_MAX:
                self._claimants[address] = now_ns + CLAIMANT_NS
        return outcome.accepted

    def _refused(self, sender_hw: int, refusal: Refusal, size: int) -> None:
        refused = self._counters.refused
        known = self._protocol.topology.neighbours.get(sender_hw) is not None
        link = self._counters.datagram_received(
            size, self._protocol.nodes.platform(sender_hw) if known else _UNKNOWN
        )
        if refusal is Refusal.REPLAYED:
            refused.replayed += 1
            link.duplicates += 1
        elif refusal is Refusal.FORGED:
            refused.forged += 1
        elif refusal is Refusal.UNKNOWN:
            refused.unknown_session += 1
        else:
            refused.other_epoch += 1

    def close(self) -> None:
        """Close the sockets for beacons."""
        self._udp.close()
