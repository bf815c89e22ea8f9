"""Former datagrams, false sessions and second computers, at real brokers on the wire."""

import asyncio
import shutil
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

import pytest
from tests.integration.broker.swarm import Station, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, Header
from swarmware.model.names import hardware_id
from swarmware.module.writer import BoardWriter
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.seal import Sealer
from swarmware.types.traffic import Traffic
from swarmware.types.vehicle import Pose

GROUP = "239.83.87.1"


def on_the_group(port: int) -> socket.socket:
    """An unknown process that receives the multicast group and has no key."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.bind((GROUP, port))
    member = socket.inet_aton(GROUP) + socket.inet_aton("127.0.0.1")
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
    return sock


@asynccontextmanager
async def listener(port: int) -> AsyncIterator[socket.socket]:
    with on_the_group(port) as sock:
        yield sock


async def record(sock: socket.socket, hw: int, count: int) -> list[bytes]:
    loop = asyncio.get_running_loop()
    tape: list[bytes] = []
    async with asyncio.timeout(PATIENCE_S):
        while len(tape) < count:
            data = await loop.sock_recv(sock, 2048)
            if codec.sender_of(data) == hw:
                tape.append(data)
    return tape


def not_taken(traffic: Traffic) -> int:
    return traffic.refused.unproven + traffic.refused.replayed + traffic.refused.unknown_session


@on_uvloop
async def test_record_of_dead_node_restores_nothing(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        dead, receiver = pair["uav1"], pair["uav2"]
        async with listener(receiver.group_port) as sock:
            pose = dead.app.writer("nav/pose", Pose)
            dead.plan([("nav/pose", Pose)])
            receiver.plan(wants=[("uav1", "nav/pose", Pose)])
            mirror = receiver.app.reader("/uav1/nav/pose", Pose)
            await receiver.until_up("uav1")
            await dead.until_up("uav2")
            writing = asyncio.create_task(write(pose))
            await mirror.changed()
            tape = await record(sock, hardware_id("uav1"), 30)
            writing.cancel()
            await dead.stop()
            await receiver.stop()
            await receiver.start()
            seen = mirror.position
            for data in tape * 12:
                sock.sendto(data, (GROUP, receiver.group_port))
                await asyncio.sleep(0.002)
            traffic = await receiver.until_counted(lambda traffic: not_taken(traffic) >= len(tape) * 10)
            assert traffic.refused.unproven > 0
            assert "uav1" not in receiver.states(), "not even heard"
            assert receiver.ways() == {}
            assert mirror.position == seen, "no value of the dead one was handed on"
            await dead.start()
            await receiver.until_up("uav1")


async def write(pose: BoardWriter[Pose]) -> None:
    step = 0
    while True:
        step += 1
        pose.write(Pose.planar(float(step), 0.0))
        await asyncio.sleep(0.05)


@on_uvloop
async def test_datagram_of_member_cannot_lock_another_platform_out(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2", "gcs") as cell:
        victim = cell["uav1"]
        await victim.until_up("gcs", "uav2")
        hw, session = hardware_id("gcs"), 2**64 - 2
        keys = Keys.load(tmp_path / "keys" / "uav2", "uav2")  # a member has the group key
        clear = codec.encode_header(Header(keys.group.epoch, hw, 5, 0, session))
        data = clear + Sealer(keys.group, hw, session).seal(5, clear, codec.encode(Beacon()))
        async with listener(victim.group_port) as sock:
            sock.sendto(data, (GROUP, victim.group_port))
        await victim.until_counted(lambda traffic: traffic.refused.unproven > 0)
        before = await victim.traffic()
        heard = {link.platform: link.received_frames for link in before.links if link.transport == "udp"}

        def more(traffic: Traffic) -> bool:
            now = {link.platform: link.received_frames for link in traffic.links if link.transport == "udp"}
            return now["gcs"] >= heard["gcs"] + 3

        await victim.until_counted(more)
        await victim.until_up("gcs")
        await cell["gcs"].stop()
        await cell["gcs"].start()
        await victim.until_up("gcs")


@on_uvloop
async def test_node_without_former_clock_and_data_is_accepted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        await pair["uav1"].until_up("uav2")
        await pair["uav2"].stop()
        (pair["uav2"].node.config.data_path / "broker.session").unlink()
        monkeypatch.setattr("swarmd.broker.service.utc_ns", lambda: 7_000_000_000)
        await pair["uav2"].start()
        await pair["uav1"].until_up("uav2")
        await pair["uav2"].until_up("uav1")


@on_uvloop
async def test_two_computers_with_one_name_notice_each_other(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        await pair["uav1"].until_up("uav2")
        await pair["uav2"].until_up("uav1")
        copy = await second(tmp_path, pair["uav2"])
        try:
            await copy.open()
            for station in (pair["uav2"], copy, pair["uav1"]):
                await station.until(partial(says_duplicate, station), station.checks)
        finally:
            await copy.close()
        await pair["uav1"].until_up("uav2")
        await pair["uav2"].until_up("uav1")
        writer = pair["uav2"].app.writer("nav/pose", Pose)
        pair["uav2"].plan([("nav/pose", Pose)])
        pair["uav1"].plan(wants=[("uav2", "nav/pose", Pose)])
        mirror = pair["uav1"].app.reader("/uav2/nav/pose", Pose)
        writing = asyncio.create_task(write(writer))
        async with asyncio.timeout(PATIENCE_S):
            await mirror.changed()
        writing.cancel()
        for station in pair.values():
            await station.until(lambda s=station: not says_duplicate(s), station.checks)  # type: ignore[misc]


def says_duplicate(station: Station) -> bool:
    return station.conditions().get("broker/name") == "duplicate"


async def second(root: Path, original: Station) -> Station:
    """A copy of a node's card in another computer."""
    folder = root / "copy"
    await asyncio.to_thread(shutil.copytree, original.config_dir, folder / "etc")
    path = folder / "etc" / "node.toml"
    text = await asyncio.to_thread(path.read_text)
    for name in ("run", "shm", "data"):
        text = text.replace(str(root / "uav2" / name), str(folder / name))
    await asyncio.to_thread(path.write_text, text)
    return Station(folder / "etc")
