"""Broker cores in virtual time, each with the driver that the daemon has, and datagrams as on the wire."""

import re
import struct
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Final

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import BODY_LIMIT, Beacon, Header, PlatformCode
from swarmd.broker.core.beacon.declared_period import RestartState
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.beacon.request_parts import request_part_bytes
from swarmd.broker.core.boards.board_action import WriteMirrors
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.broker import Action, BrokerCore
from swarmd.broker.core.membership.roster.roster_exchange import RosterExchange, SendRoster
from swarmd.broker.core.membership.sessions import SwarmMembership
from swarmd.broker.core.membership.signatures.own_signatures import OwnSignatures, SigningKeys
from swarmd.broker.core.swarm.links.link import LinkChanged, LinkState
from swarmd.broker.core.swarm.routes.routing_table import RouteChanged
from swarmd.broker.core.traffic import IP_UDP_BYTES
from swarmware.model.clock import Clock
from swarmware.model.names import hardware_id
from swarmware.runtime.driver import CoreDriver
from swarmware.testing.virtual import VirtualSwarm
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.seal import ReceivedSession, Refusal
from swarmware.transport.sodium import KEY_BYTES, SealKey, SigningKey
from swarmware.types.net import BoardSubscription

SEAL_BYTES: Final = 16
_SESSION: Final = struct.Struct("<Q")
"""Stands for what the seal proves: the session of the sender."""
SENDER_ADDRESS: Final = ("10.0.0.1", 1)
TCP_PORT: Final = 7447
UNNAMED: Final = re.compile("[0-9a-f]{8}")
"""A node whose name is not known yet: its hardware id."""
OVERHEAD: Final = SEAL_BYTES + IP_UDP_BYTES
"""What a datagram has beside header and body."""


@lru_cache(maxsize=1024)
def beacon_of(data: bytes) -> Beacon:
    """Decodes the body of a datagram, once for all its receivers."""
    _, start = codec.decode_header(data[_SESSION.size :])
    return codec.decode(data[_SESSION.size + start :])


def datagram(session: int, header: Header, beacon: Beacon) -> bytes:
    """Encodes a datagram as on the wire; instead of the seal, its session is in front."""
    body = codec.encode(beacon)
    assert len(body) <= BODY_LIMIT
    return _SESSION.pack(session) + codec.encode_header(header) + body


def signed_datagram(
    session: int, header: Header, beacon: Beacon, signatures: OwnSignatures, now_ns: int
) -> bytes:
    """Encodes a datagram with its signature."""
    data = datagram(session, header, beacon)
    clear, body = clear_and_body(data)
    signed = data[: -len(body)] + signatures.signed(clear, body, beacon.values, now_ns // 1000)
    assert len(signed) - len(clear) - _SESSION.size <= BODY_LIMIT
    return signed


def wire_bytes(data: bytes) -> int:
    """Length of a datagram in the air, with seal, UDP and IP."""
    return len(data) - _SESSION.size + OVERHEAD


def header_of(data: bytes) -> Header:
    """Decodes the header of a datagram, which then names its session."""
    header, _ = codec.decode_header(data[_SESSION.size :])
    [header.session] = _SESSION.unpack_from(data)
    return header


def clear_and_body(data: bytes) -> tuple[bytes, bytes]:
    """Clear header and body of a datagram."""
    _, start = codec.decode_header(data[_SESSION.size :])
    return data[_SESSION.size : _SESSION.size + start], data[_SESSION.size + start :]


@lru_cache(maxsize=256)
def signing_key(name: str) -> SigningKey:
    """The key of a simulated node."""
    return SigningKey(name.encode().ljust(KEY_BYTES))


class NoSeal(SealKey):
    """Stands for the key of a session: simulated datagrams are not sealed."""

    def open(self, nonce: bytes, box: bytes, clear: bytes) -> bytes:
        return box


class SimulatedKeys:
    """Signing keys of a node, whose roster has every name of a platform."""

    is_open = False

    def __init__(self, name: str) -> None:
        self._key = signing_key(name)

    def sign(self, data: bytes) -> bytes:
        return self._key.sign(data)

    def sign_public_of(self, platform: str) -> bytes | None:
        return None if UNNAMED.fullmatch(platform) else signing_key(platform).public


class _Core(BrokerCore):
    """The broker's core, which reports each change of a route at the instant of the change."""

    on_routes: Callable[[list[RouteChanged]], None] | None = None

    def _on_changes(
        self, links: list[LinkChanged], routes: list[RouteChanged], actions: list[Action], now_ns: int
    ) -> None:
        super()._on_changes(links, routes, actions, now_ns)
        if routes and self.on_routes is not None:
            self.on_routes(routes)


class BrokerNode:
    """One node: a broker core, its driver, and what its actions said."""

    def __init__(
        self,
        air: VirtualSwarm[str],
        name: str,
        clock: Clock,
        *,
        config: Config | None = None,
        session: int = 1,
        former: RestartState = RestartState(),  # noqa: B008  # frozen
        write_boards: Callable[["BrokerNode", int], None] = lambda node, now_ns: None,
        on_value: Callable[["BrokerNode", BoardSubscription, RemoteValue], None] = lambda *_: None,
        on_routes: Callable[["BrokerNode", list[RouteChanged]], None] | None = None,
        keys: Keys | None = None,
        signing: SigningKeys | None = None,
        on_roster: Callable[["BrokerNode", SendRoster], None] = lambda *_: None,
    ) -> None:
        """`write_boards`: puts the values of the own boards before a beacon; `on_routes`: takes each change
        of a route, at once; `on_roster`: carries a message about the roster to another node."""
        self.air = air
        self.name = name
        self.hw = hardware_id(name)
        self.clock = clock
        self.core = _Core(
            NodeIdentity(self.hw, name, "main", PlatformCode.UAV, 1, b""),
            config or Config(),
            session,
            former=former,
            now_ns=clock.now_ns(),
            chance=air.random.random,
            membership=SwarmMembership(
                None if keys is None else RosterExchange(keys, self.hw, air.random.random), signing
            ),
        )
        if on_routes is not None:
            self.core.on_routes = partial(on_routes, self)
        if keys is not None:
            self.core.set_ports(TCP_PORT, 0)
        self.actions: list[Action] = []
        """All but the values of boards."""
        self.links: list[LinkChanged] = []
        self.link_states: dict[int, LinkState] = {}
        self.declared_period_ns = former.declared_period_ns
        """What the daemon stores for its next start."""
        self._received: dict[tuple[int, int], ReceivedSession] = {}
        self.sent = 0
        """Number of beacons."""
        self.sent_bytes = 0
        """Bytes of all beacons, with seal, UDP and IP."""
        self.directory_bytes = 0
        """Bytes of their echoes, route rows and sequence requests, to all neighbours or to one."""
        self._write_boards = write_boards
        self._on_value = on_value
        self._on_roster = on_roster
        self.driver: CoreDriver[Action] = air.drive(
            self, self._perform, clock=clock, settled=self._send_due_beacon
        )
        air.join(name, self.receive)
        self.driver.feed()

    def deadline_ns(self) -> int | None:
        return self.core.deadline_ns()

    def on_timer(self, now_ns: int) -> list[Action]:
        if self.core.begin_turn(now_ns):
            self._write_boards(self, now_ns)
        return self.core.on_timer(now_ns)

    def _send_due_beacon(self) -> None:
        if self.core.beacon_due:
            self._send(self.clock.now_ns())

    def _perform(self, action: Action) -> None:
        match action:
            case WriteMirrors(values):
                for want, value in values:
                    self._on_value(self, want, value)
            case LinkChanged(hw, _, state):
                self.links.append(action)
                self.link_states[hw] = state
            case SendRoster():
                self.actions.append(action)
                self._on_roster(self, action)
            case _:
                self.actions.append(action)

    def _send(self, now_ns: int) -> None:
        outgoing = self.core.compose(now_ns)
        self.declared_period_ns = outgoing.declared_period_ns or self.declared_period_ns
        stated = self.core.session if outgoing.with_session else None
        exchange = self.core.exchange
        mark = 0 if exchange is None else exchange.epochs.sealing.mark
        header = Header(mark, self.hw, outgoing.sequence, now_ns // 1000 & 0xFFFF_FFFF, stated)
        signatures, session = self.core.signatures, self.core.session
        if signatures is None:
            data = datagram(session, header, outgoing.beacon)
        else:
            data = signed_datagram(session, header, outgoing.beacon, signatures, now_ns)
        size = wire_bytes(data)
        self.core.on_sent(outgoing.sequence, size - IP_UDP_BYTES, now_ns)
        self.sent += 1
        self.sent_bytes += size
        beacon = outgoing.beacon
        self.directory_bytes += (
            len(beacon.echoes) * codec.ECHO_BYTES
            + len(beacon.rows) * codec.ROW_BYTES
            + len(beacon.requests) * codec.REQUEST_BYTES
            + request_part_bytes(beacon.neighbour_requests)
        )
        self.air.multicast(self.name, data)

    def receive(self, _sender: str, data: bytes) -> None:
        """Takes a datagram from the air."""
        size = wire_bytes(data) - IP_UDP_BYTES
        if self.core.exchange is not None and not self._opens(self.core.exchange, header_of(data), data):
            return
        header, now_ns = header_of(data), self.clock.now_ns()
        clear, body = clear_and_body(data)
        session = header.session or 0
        received = self._received.setdefault(
            (header.sender_hw, session), ReceivedSession(session, NoSeal(bytes(KEY_BYTES)))
        )
        if isinstance(received.open(header.sender_hw, header.sequence, clear, body), Refusal):
            return
        checked = self.core.check(header, beacon_of(data), clear, body, SENDER_ADDRESS[0])
        if checked.is_genuine:
            received.take(header.sequence)
        _, actions = self.core.on_datagram(
            header, beacon_of(data), SENDER_ADDRESS, True, size, checked, None, now_ns
        )
        self.driver.feed(actions)

    def _opens(self, exchange: RosterExchange, header: Header, data: bytes) -> bool:
        """What the transport does before the core: revoked senders, and the key that opens the datagram."""
        now_ns = self.clock.now_ns()
        if exchange.excludes(header.sender_hw):
            self.core.counters.refused.revoked += 1
            return False
        if exchange.epochs.opening(header.epoch, now_ns) is not None:
            return True
        self.core.counters.refused.other_epoch += 1
        hello = beacon_of(data).hello
        if exchange.former_key(header.epoch) is not None and hello is not None:
            late = exchange.on_late(
                header.sender_hw, hello.name, hello.roster_version, SENDER_ADDRESS[0], hello.tcp_port, now_ns
            )
            self.driver.feed(self.core.on_roster_actions(late, now_ns))
        return False

    def take_roster(self, sender: str, payload: bytes) -> None:
        """A message about the roster arrives over the connection of a member."""
        assert self.core.exchange is not None
        now_ns = self.clock.now_ns()
        found = self.core.exchange.on_message(hardware_id(sender), sender, payload, SENDER_ADDRESS[0], now_ns)
        self.driver.feed(self.core.on_roster_actions(found, now_ns))

    def hand_over(self, text: bytes) -> None:
        """An operator gives this node a roster."""
        assert self.core.exchange is not None
        now_ns = self.clock.now_ns()
        self.driver.feed(self.core.on_roster_actions(self.core.exchange.on_text(text, now_ns), now_ns))

    def of(self, kind: type[Action]) -> Sequence[Action]:
        """The actions of one kind."""
        return [action for action in self.actions if isinstance(action, kind)]

    def stop(self) -> None:
        """The node is gone."""
        self.driver.stop()
        self.air.leave(self.name)
