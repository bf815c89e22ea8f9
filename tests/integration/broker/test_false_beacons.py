"""A member with valid keys seals a thousand beacons in the name of another one, on the wire."""

import asyncio
import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest
from tests.integration.broker.hostile import found_by_doctor
from tests.integration.broker.swarm import Station, on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, BoardValue, Header, Hello, OutgoingBeacon, PlatformCode
from swarmd.broker.core.beacon_protocol import BeaconProtocol, ReceivedBeacon
from swarmd.broker.core.broker import BrokerCore
from swarmware.model.names import data_id, hardware_id
from swarmware.module.board import BoardReader
from swarmware.module.stream import StreamReader
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.seal import Sealer
from swarmware.types.net import Denial
from swarmware.types.vehicle import Pose

TRIES: Final = 1000
POSE: Final = data_id("nav/pose", "Pose")
INVENTED_Y_M: Final = 666.0
INVENTED: Final = Pose.planar(0.0, INVENTED_Y_M).pack()


class Forger:
    """Seals beacons with the group key of uav2, and checks which of them are accepted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.believed: dict[str, int] = {}
        """False beacons whose content was taken, by receiver."""
        self.last: dict[str, tuple[int, int]] = {}
        """Number and session of the last beacon of each node, as all nodes receive them."""
        compose, on_beacon = BrokerCore.compose, BeaconProtocol.on_beacon

        def composed(core: BrokerCore, now_ns: int) -> OutgoingBeacon:
            outgoing = compose(core, now_ns)
            self.last[core.identity.platform] = outgoing.sequence, core.session
            return outgoing

        def received(
            protocol: BeaconProtocol,
            header: Header,
            beacon: Beacon,
            address: tuple[str, int],
            rx_ns: int,
            *proof: object,
        ) -> ReceivedBeacon | None:
            if any(value.payload == INVENTED for value in beacon.values):
                name = protocol.identity.platform
                self.believed[name] = self.believed.get(name, 0) + 1
            return on_beacon(protocol, header, beacon, address, rx_ns, *proof)  # type: ignore[arg-type]  # passed on

        monkeypatch.setattr(BrokerCore, "compose", composed)
        monkeypatch.setattr(BeaconProtocol, "on_beacon", received)

    @contextmanager
    def opened(self, root: Path, group_port: int) -> Iterator[None]:
        self._group = Keys.load(root / "keys" / "uav2", "uav2").group
        self._port = group_port
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as self._socket:
            interface = socket.inet_aton("127.0.0.1")
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
            yield

    async def forge(self, victim: str, ahead: int, *, session: int | None = None) -> None:
        """A thousand beacons, numbered from `ahead` after the last true one on."""
        used, present = self.last.get(victim, (1000, 0))
        hw, given = hardware_id(victim), session or present
        sealer = Sealer(self._group, hw, given)
        beacon = Beacon(
            hello=Hello(1, 0, 1, 1, 0, PlatformCode.UAV, victim),
            values=(BoardValue(POSE, 0, True, INVENTED),),
        )
        for number in range(used + ahead, used + ahead + TRIES):
            clear = codec.encode_header(Header(self._group.mark, hw, number, 0, given))
            data = clear + sealer.seal(number, clear, codec.encode(beacon))
            self._socket.sendto(data, ("239.83.87.1", self._port))
            if number % 20 == 0:
                await asyncio.sleep(0.002)


@pytest.fixture
def forger(monkeypatch: pytest.MonkeyPatch) -> Forger:
    return Forger(monkeypatch)


class Poses:
    """Poses of a victim that moves, at a receiver."""

    def __init__(self, victim: Station, receiver: Station) -> None:
        victim.plan([("nav/pose", Pose)])
        receiver.plan(wants=[(victim.platform, "nav/pose", Pose)])
        self._receiver = receiver
        self._writer = victim.app.writer("nav/pose", Pose)
        self._reader: BoardReader[Pose] = receiver.app.reader(f"/{victim.platform}/nav/pose", Pose)

    async def arrive(self, x_m: float) -> None:
        """The next true pose arrives, and is then the value of the board."""
        self._writer.write(Pose.planar(x_m, 0.0))
        reader = self._reader
        await self._receiver.until(lambda: reader.value is not None and reader.value.x_m == x_m, reader)
        assert reader.value is not None
        assert reader.value.y_m == 0.0


async def is_reported(
    receiver: Station, denials: StreamReader[Denial], caplog: pytest.LogCaptureFixture
) -> None:
    """The receiver has said that a member sealed beacons of uav1: in the event, by doctor, and in the
    journal."""
    denial = await denials.next(PATIENCE_S)
    assert denial.verb == "beacon"
    assert "in the name of uav1 that uav1 never sent: sealed by a member" in denial.reason
    found = await found_by_doctor(receiver, "denied")
    assert "revoke it" in found.advice
    assert "impersonated" in (await found_by_doctor(receiver, "refused")).text
    assert any("that uav1 never sent" in record.getMessage() for record in caplog.records)


@pytest.mark.parametrize("ahead", [1, 50_000])
@on_uvloop
async def test_thousand_false_beacons_are_all_refused(
    tmp_path: Path, forger: Forger, caplog: pytest.LogCaptureFixture, ahead: int
) -> None:
    caplog.set_level(logging.INFO)
    async with swarm(tmp_path, "uav1", "uav2", "uav3") as cell:
        victim, receiver = cell["uav1"], cell["uav3"]
        for station in cell.values():
            await station.until_up(*(name for name in cell if name != station.platform))
        poses = Poses(victim, receiver)
        await poses.arrive(1.0)
        denials = receiver.app.stream_reader("net/denials", Denial)
        with forger.opened(tmp_path, victim.group_port):
            await forger.forge("uav1", ahead)
            await poses.arrive(2.0)
            await receiver.until_counted(lambda traffic: traffic.refused.unsigned >= TRIES // 2)
            counted = (await receiver.traffic()).refused
        assert forger.believed == {}, "by nobody, not the first one either"
        assert counted.impersonated >= counted.unsigned, "each one that is refused is evidence"
        await receiver.until_up("uav1")
        await is_reported(receiver, denials, caplog)


@on_uvloop
async def test_node_out_of_range_is_not_a_neighbour(tmp_path: Path, forger: Forger) -> None:
    far = {"uav3": {"udp_port": free_port()}}
    async with swarm(tmp_path, "uav1", "uav2", "uav3", settings=far) as cell:
        receiver = cell["uav1"]
        await receiver.until_up("uav2")
        with forger.opened(tmp_path, receiver.group_port):
            await forger.forge("uav3", 1)
            await receiver.until_counted(lambda traffic: traffic.refused.unsigned >= TRIES // 2)
        assert forger.believed == {}
        assert "uav3" not in receiver.states()


@on_uvloop
async def test_the_victim_finds_false_beacons_in_its_name(tmp_path: Path, forger: Forger) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        victim = pair["uav1"]
        await victim.until_up("uav2")
        denials = victim.app.stream_reader("net/denials", Denial)
        with forger.opened(tmp_path, victim.group_port):
            await forger.forge("uav1", 5000)
            await victim.until_counted(lambda traffic: traffic.refused.impersonated >= TRIES // 2)
        denial = await denials.next(PATIENCE_S)
        assert (denial.platform, denial.verb) == ("127.0.0.1", "beacon")
        assert "in the name of uav1 that uav1 never sent" in denial.reason
        found = await found_by_doctor(victim, "denied")
        assert found.text.startswith("unknown@127.0.0.1: beacon: ")
        assert "revoke it" in found.advice
