"""Broker cores in virtual time, each with the driver that the daemon has, and datagrams as on the wire."""

import struct
from collections.abc import Callable, Sequence
from typing import Final

from swarmd.broker.config import Config
from swarmd.broker.core.action import Action, PollInputs, SendBeacon, WriteMirrors
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import BODY_LIMIT, Header, PlatformCode
from swarmd.broker.core.beacon_protocol import NodeIdentity
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.broker import BrokerCore, FormerState
from swarmd.broker.core.topology.link import LinkChanged
from swarmware.model.clock import Clock
from swarmware.model.names import hardware_id
from swarmware.runtime.driver import CoreDriver
from swarmware.testing.virtual import VirtualSwarm
from swarmware.types.net import BoardSubscription

SEAL_BYTES: Final = 16
_SESSION: Final = struct.Struct("<Q")
"""Stands for what the seal proves: the session of the sender."""
ADDRESS: Final = ("10.0.0.1", 1)


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
        write_boards: Callable[["BrokerNode", int], None] = lambda node, now_ns: None,
        on_value: Callable[["BrokerNode", BoardSubscription, RemoteValue], None] = lambda *_: None,
    ) -> None:
        """`write_boards`: puts the values of the own boards before a beacon."""
        self.air = air
        self.name = name
        self.hw = hardware_id(name)
        self.clock = clock
        self.core = BrokerCore(
            NodeIdentity(self.hw, name, "main", PlatformCode.UAV, 1, b""),
            config or Config(),
            session,
            connections=False,
            former=FormerState(),
            now_ns=clock.now_ns(),
            chance=air.random.random,
        )
        self.actions: list[Action] = []
        """All but the requests for inputs, for beacons, and values of boards."""
        self.links: list[LinkChanged] = []
        self.sent: list[int] = []
        """Size of each beacon, with header and seal."""
        self._write_boards = write_boards
        self._on_value = on_value
        self.driver: CoreDriver[Action] = air.drive(self.core, self._perform, clock=clock)
        air.join(name, self.receive)
        self.driver.feed()

    def _perform(self, action: Action) -> None:
        match action:
            case PollInputs(boards):
                now_ns = self.clock.now_ns()
                if boards:
                    self._write_boards(self, now_ns)
                self.driver.feed(self.core.on_inputs_read(now_ns))
            case SendBeacon():
                self._send(self.clock.now_ns())
            case WriteMirrors(values):
                for want, value in values:
                    self._on_value(self, want, value)
            case LinkChanged():
                self.links.append(action)
            case _:
                self.actions.append(action)

    def _send(self, now_ns: int) -> None:
        outgoing = self.core.compose(now_ns)
        body = codec.encode(outgoing.beacon)
        assert len(body) <= BODY_LIMIT
        session = self.core.session if outgoing.with_session else None
        header = codec.encode_header(
            Header(0, self.hw, outgoing.sequence, now_ns // 1000 & 0xFFFF_FFFF, session)
        )
        size = len(header) + len(body) + SEAL_BYTES
        self.core.on_sent(outgoing.sequence, size, now_ns)
        self.sent.append(size)
        self.air.multicast(self.name, _SESSION.pack(self.core.session) + header + body)

    def receive(self, _sender: str, data: bytes) -> None:
        """Takes a datagram from the air."""
        header, start = codec.decode_header(data[_SESSION.size :])
        [header.session] = _SESSION.unpack_from(data)
        beacon = codec.decode(data[_SESSION.size + start :])
        _, actions = self.core.on_datagram(
            header, beacon, ADDRESS, True, len(data) - _SESSION.size + SEAL_BYTES, self.clock.now_ns()
        )
        self.driver.feed(actions)

    def of(self, kind: type[Action]) -> Sequence[Action]:
        """The actions of one kind."""
        return [action for action in self.actions if isinstance(action, kind)]

    def stop(self) -> None:
        """The node is gone."""
        self.driver.stop()
        self.air.leave(self.name)
