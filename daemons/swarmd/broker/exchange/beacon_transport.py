"""Sends and receives beacons over UDP: sealed, counted, by multicast and by unicast."""

import asyncio
import logging
import struct
from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Header, OutgoingBeacon
from swarmd.broker.core.broker import Action, BrokerCore
from swarmd.broker.core.membership.datagram_limiter import DatagramLimiter, member_ids
from swarmd.broker.core.membership.roster.roster_exchange import RosterExchange
from swarmd.broker.core.swarm.media.medium import Address, MediumProfile
from swarmd.broker.core.swarm.neighbours.medium_table import ByMedium
from swarmd.broker.core.swarm.node_table import is_named
from swarmd.broker.core.traffic import EVERYBODY
from swarmd.broker.sockets.media import Media
from swarmd.broker.sockets.medium import MediumDatagram
from swarmd.broker.sockets.udp import LOOPBACK, resolve
from swarmware.errors import SwarmError, WireError
from swarmware.model.clock import Clock
from swarmware.model.names import hardware_id
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.roster import RosterChange
from swarmware.transport.security.seal import Opened, Opener, Refusal, Sealer
from swarmware.types.net import UNACCEPTED

UNRETURNED_MAX: Final = 20
"""Own beacons without loopback, and without any other node's, after which multicast counts as missing."""
PROBE_EVERY: Final = 20
"""Without multicast, every twentieth beacon still probes the group."""
SEEDS_S: Final = 30.0
"""Period in which the names of seeds are resolved again."""
FAULTS: Final = (
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
    struct.error,
    SwarmError,
)
"""Exceptions of a defect of this program on input from outside: the datagram is dropped, the broker
continues."""
FAULTS_LOGGED: Final = 5
"""Faults that are logged with their traceback; the others are only counted."""

log = logging.getLogger("swarm.broker")


class BeaconTransport:
    """Seals and sends the beacons that the core composes; opens received ones and passes them to it."""

    def __init__(
        self,
        config: Config,
        keys: Keys,
        media: Media,
        clock: Clock,
        core: BrokerCore,
        feed: Callable[[Iterable[Action]], None],
        keep_period: Callable[[int], None],
    ) -> None:
        """`feed`: has the actions of a received beacon carried out."""
        self._config = config
        self._clock = clock
        self._core = core
        self._counters = core.counters
        self._feed = feed
        self._keep_period = keep_period
        self._hardware = core.identity.hw
        self._keys = keys
        self._group = keys.group
        self._session = core.session
        self._sealer = Sealer(keys.group, self._hardware, core.session)
        self._openers = {one.number: {keys.group.mark: Opener(keys.group)} for one in media.profiles}
        """Openers of the newest and former group keys, by mark, for each medium: a copy that came over
        another one is not a replay."""
        self._newest = {number: openers[keys.group.mark] for number, openers in self._openers.items()}
        self._limiter = DatagramLimiter(member_ids(keys.roster))
        self._hear = frozenset(hardware_id(name) for name in config.hear_only) or None
        self._sequence = -1
        """Number of the last own beacon."""
        self._unreturned = 0
        self._faults = 0
        self._seeds: dict[str, Address] = {}
        self._loop = asyncio.get_running_loop()
        self._media = media
        self._udp = media.main

    @property
    def port(self) -> int:
        """Our own UDP port."""
        return self._udp.port

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
        """Composes and sends the next beacon; if it cannot be composed, that is counted and it is skipped."""
        try:
            outgoing = self._core.compose(now_ns)
            if outgoing.declared_period_ns:
                self._keep_period(outgoing.declared_period_ns)
            self._send(outgoing, now_ns)
        except FAULTS:
            self._counters.failed_ticks += 1
            self.log_fault("a beacon could not be composed")

    def log_fault(self, what: str) -> None:
        """Logs a defect of this program with its traceback, the first few times."""
        self._faults += 1
        if self._faults <= FAULTS_LOGGED:
            log.exception("%s; please report this", what)

    def _send(self, outgoing: OutgoingBeacon, composed_ns: int) -> None:
        """Sends a beacon, stamped as late as possible; `composed_ns`: instant to which its ages and echoes
        refer."""
        beacon, sequence = outgoing.beacon, outgoing.sequence
        self._sequence = sequence
        exchange = self._core.exchange
        # neighbours have the new group key; from this beacon on it seals
        if exchange is not None and exchange.epochs.sealing is not self._group:
            self._group = exchange.epochs.sealing
            self._sealer = Sealer(self._group, self._hardware, self._session)
            log.info("beacons are sealed with group key %d", self._group.epoch)
        body = bytearray(codec.encode(beacon))
        # read after encoding; echoes and clock differences refer to the instant of the send
        tx_ns = self._clock.now_ns()
        if beacon.hello is not None and tx_ns // 1000 >> 32 != beacon.hello.clock_high:
            hello = msgspec.structs.replace(beacon.hello, clock_high=tx_ns // 1000 >> 32)
            body = bytearray(codec.encode(msgspec.structs.replace(beacon, hello=hello)))
        codec.shift_echoes(body, tx_ns // 1000 - composed_ns // 1000)
        clear = codec.encode_header(
            Header(
                self._group.mark,
                self._hardware,
                sequence,
                tx_ns // 1000 & 0xFFFF_FFFF,
                self._session if outgoing.with_session else None,
            )
        )
        signatures = self._core.signatures
        content = bytes(body)
        if signatures is not None:
            content = signatures.signed(clear, body, beacon.values, tx_ns // 1000)
        data = clear + self._sealer.seal(sequence, clear, content)
        # without multicast a probe now and then finds out when it works again
        if self._udp.has_group and (self._unreturned < UNRETURNED_MAX or sequence % PROBE_EVERY == 0):
            self._to_group(data)
        for address in self._core.targets.unicast_addresses(self._seeds.values(), tx_ns):
            if self._udp.send(data, address):
                self._counters.datagram_sent(len(data), f"{address[0]}:{address[1]}")
        for medium in self._media.further:
            if medium.send_to_all(data):
                self._counters.datagram_sent(
                    medium.medium.counted_bytes(len(data)), EVERYBODY, medium.medium.transport
                )
        self._core.on_sent(sequence, len(data), tx_ns)

    def _to_group(self, data: bytes) -> None:
        if self._udp.send_to_all(data):
            self._counters.datagram_sent(len(data), EVERYBODY)
        self._unreturned += 1
        if self._unreturned == UNRETURNED_MAX:
            log.warning(
                "multicast does not work here: only seeds and senders of unicast datagrams are reached"
            )

    # receiving

    def receive(self) -> None:
        """Reads the datagrams that wait in the sockets, without the delay of batching."""
        self._media.receive()
        self._udp.set_min_period(self._core.usual_period_ns())

    def on_datagram(self, medium: MediumProfile, arrival: MediumDatagram) -> None:
        """Takes a datagram that came over a medium."""
        data, address, rx_mono_ns = arrival.data, arrival.address, arrival.rx_mono_ns
        by_multicast = arrival.by_multicast
        sender_hw = codec.sender_of(data)
        if sender_hw == self._hardware and self._is_own(medium, data, address, rx_mono_ns):
            if medium is self._udp.medium:
                self._unreturned = 0  # multicast loops datagrams back
            return
        # before everything else; a simulated distance must cost nothing
        if self._hear is not None and sender_hw not in self._hear:
            self._counters.refused.unheard += 1
            return
        exchange = self._core.exchange
        if exchange is not None and exchange.excludes(sender_hw):
            self._on_revoked(exchange, medium, data, address, rx_mono_ns)
            return
        if not self._limiter.may_open(address, sender_hw, rx_mono_ns):
            self._counters.refused.flooded += 1
            return
        try:
            header, start = codec.decode_header(data)
            now_ns = self._clock.from_mono_ns(rx_mono_ns)
            opener = self._opener(medium, header.epoch, now_ns)
            opened = _open(opener, header, data, start)
            if isinstance(opened, Refusal):
                is_late = opened is Refusal.EPOCH and self._take_late(header, data, start, address)
                if opened is not Refusal.REPLAYED and not is_late:
                    self._limiter.bad(address)
                self._refused(header, opened, medium.counted_bytes(len(data)), medium, address, now_ns)
                return
            beacon = codec.decode(opened.body)
        except WireError as error:
            self._limiter.bad(address)
            self._counters.datagram_received(medium.counted_bytes(len(data)), UNACCEPTED, medium.transport)
            self._counters.refused.malformed += 1
            log.debug("datagram from %s:%d: %s", *address, error)
            return
        header.session = opened.session
        try:
            checked = self._core.check(header, beacon, data[:start], opened.body, address[0])
            # the replay window takes the number only now; a forged beacon must not use up the one of the
            # genuine
            if opener is not None and checked.is_genuine:
                opener.take(header.sender_hw, opened.session, header.sequence)
            is_accepted, actions = self._core.on_datagram(
                header,
                beacon,
                address,
                by_multicast,
                medium.counted_bytes(len(data)),
                checked,
                ByMedium(medium, header.sequence if arrival.number is None else arrival.number),
                now_ns,
            )
            if is_accepted:
                self._limiter.good(address)
                if by_multicast and medium is self._udp.medium:
                    self._unreturned = 0
            self._feed(actions)
        # a defect must end the datagram that shows it, never the broker, which others rely on for forwarding
        except FAULTS:
            self._counters.refused.failed += 1
            self.log_fault("a datagram could not be processed")

    def _opener(self, medium: MediumProfile, mark: int, now_ns: int) -> Opener | None:
        """The opener of an accepted key epoch."""
        exchange = self._core.exchange
        if exchange is not None and exchange.epochs.opening(mark, now_ns) is None:
            return None
        return self._openers[medium.number].get(mark)

    def _take_late(self, header: Header, data: bytes, start: int, address: Address) -> bool:
        """Takes a beacon of a node that missed a rotation: nothing but who it is and where. Whether it is
        one."""
        exchange = self._core.exchange
        key = None if exchange is None else exchange.former_key(header.epoch)
        if exchange is None or key is None or header.session is None:
            return False
        opened = _open(Opener(key), header, data, start)
        if isinstance(opened, Refusal):
            return False
        hello = codec.decode(opened.body).hello
        if hello is not None and is_named(header.sender_hw, hello.name):
            now_ns = self._clock.now_ns()
            late = exchange.on_late(
                header.sender_hw, hello.name, hello.roster_version, address[0], hello.tcp_port, now_ns
            )
            self._feed(list(late))
        return True

    def _on_revoked(
        self,
        exchange: RosterExchange,
        medium: MediumProfile,
        data: bytes,
        address: Address,
        rx_mono_ns: int,
    ) -> None:
        """Sends the roster to a platform that was revoked while it was away, if it was a member; a platform
        of another swarm with the same name is counted as such."""
        sender_hw, now_ns = codec.sender_of(data), self._clock.now_ns()
        try:
            header, start = codec.decode_header(data)
            if self._core.other_swarms.on_unopened(header.session, address, now_ns):
                size = medium.counted_bytes(len(data))
                self._counters.datagram_received(size, UNACCEPTED, medium.transport)
                self._counters.refused.other_swarm += 1
                return
            self._counters.refused.revoked += 1
            if not exchange.is_offer_due(sender_hw, now_ns):
                return
            if not self._limiter.may_open(address, sender_hw, rx_mono_ns):
                return
            if not self._take_late(header, data, start, address):
                self._limiter.bad(address)
        except WireError:
            self._counters.refused.malformed += 1
            self._limiter.bad(address)

    def on_roster(self, change: RosterChange) -> None:
        """The keys have another roster, perhaps another group key, too."""
        self._limiter.members = member_ids(self._keys.roster)
        group = self._keys.group
        if change.rotated and not change.revoked_self:
            for number, opener in self._newest.items():
                self._newest[number] = self._openers[number][group.mark] = opener.rekeyed(group)

    def adopt(self, hw: int, session: int) -> None:
        """Accepts the sequence numbers of a session from now on."""
        for openers in self._openers.values():
            for opener in openers.values():
                opener.adopt(hw, session)

    def _is_own(self, medium: MediumProfile, data: bytes, address: Address, rx_mono_ns: int) -> bool:
        """Whether an own datagram was looped back; a datagram without a session counts as own.

        A valid seal with a number that was not used yet shows that another member has forged the datagram.
        """
        try:
            header, start = codec.decode_header(data)
        except WireError:
            return True
        if header.session not in (None, self._session):
            return False
        # a number that was sent; multicast has looped the beacon back
        if header.sequence <= self._sequence:
            return True
        if not self._limiter.may_open(address, self._hardware, rx_mono_ns):
            return True
        header.session = self._session
        now_ns = self._clock.from_mono_ns(rx_mono_ns)
        opener = self._opener(medium, header.epoch, now_ns)
        if opener is None or isinstance(_open(opener, header, data, start), Refusal):
            self._limiter.bad(address)
        else:
            opener.take(self._hardware, self._session, header.sequence)
            self._feed(self._core.on_impersonation(address[0], now_ns))
        return True

    def _refused(
        self,
        header: Header,
        refusal: Refusal,
        size: int,
        medium: MediumProfile,
        address: Address,
        now_ns: int,
    ) -> None:
        refused, sender_hw = self._counters.refused, header.sender_hw
        known = self._core.has_link(sender_hw)
        link = self._counters.datagram_received(
            size, self._core.nodes.platform(sender_hw) if known else UNACCEPTED, medium.transport
        )
        if refusal is Refusal.REPLAYED:
            refused.replayed += 1
            link.duplicates += 1
        elif self._core.other_swarms.on_unopened(header.session, address, now_ns):
            refused.other_swarm += 1
        elif refusal is Refusal.FORGED:
            refused.forged += 1
        elif refusal is Refusal.UNKNOWN:
            refused.unknown_session += 1
        else:
            refused.other_epoch += 1


def _open(opener: Opener | None, header: Header, data: bytes, start: int) -> Opened | Refusal:
    """The content of a datagram; without an opener no accepted key has sealed it."""
    if opener is None:
        return Refusal.EPOCH
    return opener.open(
        header.epoch, header.sender_hw, header.session, header.sequence, data[:start], data[start:]
    )
