"""The shell of the beacons: a fault of our own code costs one datagram or one beacon, and is counted."""

import asyncio

import pytest

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, Header, PlatformCode, RouteRow
from swarmd.broker.core.beacon.declared_period import RestartState
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.beacon.parts.session_checks import CheckKind, SessionCheck
from swarmd.broker.core.boards.relay_cache import RelayCache
from swarmd.broker.core.broker import Action, BrokerCore
from swarmd.broker.core.membership.sessions import ReportImpersonation, digest
from swarmd.broker.core.swarm.links.link import LinkChanged
from swarmd.broker.core.swarm.media.medium import MediumProfile
from swarmd.broker.exchange.beacon_transport import BeaconTransport
from swarmd.broker.sockets.media import Media
from swarmd.broker.sockets.medium import MediumDatagram
from swarmware.model.clock import Clock
from swarmware.model.names import hardware_id
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.seal import Sealer

SECOND = 1_000_000_000


class Shell:
    """A node's datagrams on loopback sockets of its own, without a group."""

    def __init__(self) -> None:
        config = Config(multicast_group="", bind_address="127.0.0.1")
        self.core = BrokerCore(
            NodeIdentity(hardware_id("uav1"), "uav1", "main", PlatformCode.UAV, 1, b""),
            config,
            1,
            former=RestartState(),
            now_ns=0,
            chance=lambda: 0.5,
        )
        self.counters = self.core.counters
        self.actions: list[Action] = []
        self.kept: list[int] = []
        keys = Keys.open("uav1")
        self.media = Media(
            config,
            asyncio.get_running_loop(),
            Clock(),
            self.counters.refused,
            on_beacon=self.take,
            on_frame=lambda *_: None,
        )
        self.datagrams = BeaconTransport(
            config, keys, self.media, Clock(), self.core, self.actions.extend, self.kept.append
        )
        self.peer_hw = hardware_id("uav2")
        answer = SessionCheck(CheckKind.ANSWER, hardware_id("uav1"), digest(1))
        self.beacon = Beacon(rows=(RouteRow(9, 1, 256),), checks=(answer,))
        self.sealer = Sealer(keys.group, self.peer_hw, 1)

    def take(self, medium: MediumProfile, arrival: MediumDatagram) -> None:
        self.datagrams.on_datagram(medium, arrival)

    def receive(self, sequence: int) -> None:
        clear = codec.encode_header(Header(0, self.peer_hw, sequence, 0, 1))
        sealed = self.sealer.seal(sequence, clear, codec.encode(self.beacon))
        self.datagrams.on_datagram(
            self.media.main.medium, MediumDatagram(clear + sealed, ("127.0.0.1", 1), 0)
        )


async def test_datagram_that_raises_is_counted_and_next_taken(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    shell = Shell()
    with monkeypatch.context() as broken:
        broken.setattr(shell.core, "on_datagram", lambda *_: 1 // 0)
        for sequence in range(1, 21):
            shell.receive(sequence)
    assert shell.counters.refused.failed == 20
    assert len(caplog.records) == 5, "the log is not flooded"
    assert caplog.records[0].exc_info is not None
    shell.receive(21)
    assert sum(isinstance(action, LinkChanged) for action in shell.actions) == 1
    shell.media.close()


async def test_failed_beacon_is_counted_and_next_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shell = Shell()
    shell.core.on_timer(0)
    with monkeypatch.context() as broken:
        broken.setattr(RelayCache, "compose", lambda *_: 1 // 0)
        shell.datagrams.send_beacon(0)
    assert shell.counters.failed_ticks == 1
    due_ns = shell.core.deadline_ns()
    assert due_ns is not None
    assert 0 < due_ns <= SECOND, "the next one is scheduled"
    shell.datagrams.send_beacon(0)
    assert shell.counters.failed_ticks == 1
    assert shell.counters.sent_datagrams == 0, "nobody is there to send it to"
    shell.media.close()


async def test_forged_own_beacon_with_unused_number_is_reported() -> None:
    shell = Shell()
    shell.core.on_timer(0)
    shell.datagrams.send_beacon(0)
    own_hw, used = shell.core.identity.hw, shell.datagrams._sequence
    group = Keys.open("uav1").group

    def receive(sequence: int, *, session: int = 1, named: bool = True, damaged: bool = False) -> None:
        clear = codec.encode_header(Header(0, own_hw, sequence, 0, session if named else None))
        sealed = bytearray(Sealer(group, own_hw, session).seal(sequence, clear, codec.encode(shell.beacon)))
        sealed[-1] ^= damaged
        shell.datagrams.on_datagram(
            shell.media.main.medium, MediumDatagram(clear + sealed, ("127.0.0.9", 1), 0)
        )

    receive(used)
    receive(used + 1, damaged=True)
    receive(used + 1, session=2, named=False)
    assert shell.counters.refused.impersonated == 0, "looped back, of an outsider, of another start"
    receive(used + 1)
    receive(used + 2, named=False)
    receive(used + 2)
    assert shell.counters.refused.impersonated == 2, "a repetition proves nothing"
    assert shell.actions == [ReportImpersonation(own_hw, "127.0.0.9")] * 2
    assert shell.datagrams._unreturned == 0
    shell.media.close()
