"""The shell of the beacons: a fault of our own code costs one datagram or one beacon, and is counted."""

import pytest

from swarmd.broker.beacon_transport import BeaconTransport
from swarmd.broker.config import Config
from swarmd.broker.core import beacon_codec as codec
from swarmd.broker.core.beacon import Beacon, Header, PlatformKind, RouteRow
from swarmd.broker.core.beacon_protocol import BeaconProtocol, NodeIdentity, ReceivedBeacon
from swarmd.broker.core.session_checks import CheckKind, SessionCheck
from swarmd.broker.core.sessions import Sessions, digest
from swarmd.broker.core.topology import Topology
from swarmd.broker.core.traffic import Counters
from swarmware.model.clock import Clock
from swarmware.model.names import hardware_id
from swarmware.transport.security import Keys, Sealer

SECOND = 1_000_000_000


class Shell:
    """A node's datagrams on loopback sockets of its own, without a group."""

    def __init__(self) -> None:
        self.counters = Counters()
        hw = hardware_id("uav1")
        self.protocol = BeaconProtocol(
            NodeIdentity(hw, "uav1", "main", PlatformKind.UAV, 1, b""),
            Topology(hw, 1, SECOND, 0),
            self.counters,
            busy_hz=10.0,
            relay_bytes_s=3000.0,
        )
        self.arrivals: list[ReceivedBeacon] = []
        self.kept: list[int] = []
        config = Config(multicast_group="", bind_address="127.0.0.1")
        keys = Keys.open("uav1")
        self.datagrams = BeaconTransport(
            config,
            keys,
            1,
            Clock(),
            self.protocol,
            self.counters,
            Sessions(hw, 1, connections=False),
            self.arrivals.append,
            lambda hw, outcome: None,
            self.kept.append,
        )
        self.peer_hw = hardware_id("uav2")
        self.beacon = Beacon(
            rows=(RouteRow(9, 1, 256),), checks=(SessionCheck(CheckKind.ANSWER, hw, digest(1)),)
        )
        self.sealer = Sealer(keys.group, self.peer_hw, 1)

    def receive(self, sequence: int) -> None:
        clear = codec.encode_header(Header(0, self.peer_hw, sequence, 0, 1))
        sealed = self.sealer.seal(sequence, clear, codec.encode(self.beacon))
        self.datagrams._on_datagram(clear + sealed, ("127.0.0.1", 1), 0, True)  # the socket's door


async def test_a_datagram_on_which_our_code_fails_is_counted_and_the_next_one_is_taken(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    shell = Shell()
    with monkeypatch.context() as broken:
        broken.setattr(shell.protocol, "on_datagram", lambda *_: 1 // 0)
        for sequence in range(1, 21):
            shell.receive(sequence)
    assert shell.counters.refused.failed == 20
    assert len(caplog.records) == 5, "the log is not flooded"
    assert caplog.records[0].exc_info is not None
    shell.receive(21)
    assert len(shell.arrivals) == 1
    shell.datagrams.close()


async def test_a_beacon_that_cannot_be_composed_is_counted_and_the_next_one_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shell = Shell()
    with monkeypatch.context() as broken:
        broken.setattr(shell.protocol.relay_cache, "compose", lambda *_: 1 // 0)
        shell.datagrams.send_beacon(0)
    assert shell.counters.failed_ticks == 1
    shell.datagrams.send_beacon(0)
    assert shell.counters.failed_ticks == 1
    assert shell.protocol.topology.neighbours.echoes(0, 1, 0) == ()
    shell.datagrams.close()
