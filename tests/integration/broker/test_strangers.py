"""Other swarms, other keys and nodes without keys are not admitted."""

import asyncio
import shutil
import socket
from contextlib import ExitStack
from pathlib import Path

import pytest
import zmq
from tests.integration.broker.hostile import found_by_doctor
from tests.integration.broker.swarm import Station, on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmctl.commands.doctor.broker_checks import foreign
from swarmctl.commands.doctor.node_findings import LINK_NS
from swarmd.broker.config import Config
from swarmd.broker.sockets.zmq.tcp_count import HALF_OPEN_MAX
from swarmware.errors import Denied
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import data_id, hardware_id
from swarmware.testing.tmpnode import make_node
from swarmware.transport.delivery.outcome import Status
from swarmware.transport.enrolment.token import fingerprint
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import Root, candidate, make_swarm
from swarmware.transport.security.roster import Roster, RosterMember, sign_roster
from swarmware.transport.sodium import SigningKey, seal_box
from swarmware.types.net import LinkStatus, Neighbours, RosterState, SignedRoster
from swarmware.types.scalar import Text


@on_uvloop
async def test_another_swarm_is_dropped_and_named_by_doctor(tmp_path: Path) -> None:
    port = free_port()
    async with (
        swarm(tmp_path / "a", "uav1", "uav2", udp_port=port) as ours,
        swarm(tmp_path / "b", "uav3", udp_port=port) as theirs,
    ):
        await ours["uav1"].until_up("uav2")
        traffic = await ours["uav1"].until_counted(lambda traffic: traffic.refused.other_swarm > 5)
        assert traffic.refused.forged == 0
        assert set(ours["uav1"].states()) == {"uav2"}
        root = fingerprint((tmp_path / "b" / "keys" / "uav3" / "root.pub").read_bytes())
        assert traffic.other_swarms[0].root == root[:4]
        assert traffic.other_swarms[0].addresses == ("127.0.0.1",)
        shm = ours["uav1"].node.config.shm_path
        (found,) = await asyncio.to_thread(lambda: list(foreign(shm)))
        assert found.verdict == "warning"
        assert found.text.startswith(f"another swarm, root {root[:4]}…, on this network: ")
        assert "multicast_group" in found.advice
        assert theirs["uav3"].states() == {}
        assert {link.platform for link in traffic.links} == {"*", "uav2", "?"}


@on_uvloop
async def test_namesake_of_revoked_platform_keeps_its_own_swarm(
    tmp_path: Path,
) -> None:
    port = free_port()
    async with swarm(tmp_path / "a", "uav1", udp_port=port) as ours:
        root = Root.load(tmp_path / "a" / "keys")
        root.admit(candidate("uav2", "node", bytes(range(32)), root.public))
        receiver = ours["uav1"]
        await receiver.app.request("sys/broker/roster", SignedRoster(root.revoke("uav2")), RosterState)
        async with swarm(tmp_path / "b", "uav2", udp_port=port):
            traffic = await receiver.until_counted(lambda traffic: traffic.refused.other_swarm > 5)
        assert traffic.refused.revoked == 0
        theirs = fingerprint((tmp_path / "b" / "keys" / "uav2" / "root.pub").read_bytes())
        assert traffic.other_swarms[0].root == theirs[:4]


def replace_key(folder: Path, root: SigningKey, names: tuple[str, str]) -> None:
    """Makes keys with which `names[1]` is another one than the rest believes, in its own roster only."""
    platform = names[1]
    before = Keys.load(folder, platform)
    roster = before.roster
    assert roster is not None
    fresh = Keys(platform, bytes(range(32)), None, before.group)
    box = seal_box(fresh.curve_public, before.group.key)
    members = tuple(
        RosterMember(m.platform, m.sign_public, fresh.curve_public, m.role, m.serial, box)
        if m.platform == platform
        else m
        for m in roster.members
    )
    (folder / "node.key").write_bytes(bytes(range(32)))
    (folder / "roster.json").write_bytes(sign_roster(Roster(1, members, sign_beacons=True), root))
    (folder / "root.pub").write_bytes(root.public)


@on_uvloop
async def test_member_with_unlisted_key_becomes_no_neighbour(tmp_path: Path) -> None:
    names = ("uav1", "uav2")
    make_swarm(tmp_path / "keys", dict.fromkeys(names, "operator"))
    replace_key(tmp_path / "keys" / "uav2", SigningKey(bytes(range(32))), names)
    async with swarm(tmp_path, *names, keys=False) as pair:
        # the group key is right, but no signature of its beacons: it is a neighbour of no member
        await pair["uav1"].until_counted(lambda traffic: traffic.refused.unproven > 5)
        box = pair["uav1"].app.inbox("cmd/note", Text)
        outcome = await pair["uav2"].app.send("/uav1/cmd/note", Text("let me in"), timeout_s=2.0)
        assert outcome.status is Status.UNREACHABLE
        assert len(box) == 0
        assert (await pair["uav1"].traffic()).received_frames == 0
        assert pair["uav1"].neighbours.value == Neighbours()
        denied = await found_by_doctor(pair["uav1"], "denied")
        assert (
            "a beacon of uav2 from 127.0.0.1, signed with a key that the roster does not have" in denied.text
        )
        assert "swarmctl keys join --replace" in denied.advice
        away = pair["uav2"]

        def received_for_long() -> bool:
            found = (away.neighbours.value or Neighbours()).neighbours
            states = [(n.state, away.app.now_ns() - n.since_ns > LINK_NS) for n in found]
            return states == [(LinkStatus.RECEIVED, True)]

        await away.until(received_for_long, away.neighbours)
        link = await found_by_doctor(away, "links")
        assert link.text == "received, but not connected: uav1"
        assert "they refuse the key of this node" in link.advice


@on_uvloop
async def test_a_client_without_curve_gets_nothing_in(tmp_path: Path) -> None:
    tcp_port = free_port()
    async with swarm(tmp_path, "uav1", tcp_port=tcp_port) as one:
        with zmq.Context() as context, context.socket(zmq.DEALER) as dealer:
            dealer.setsockopt(zmq.LINGER, 0)
            dealer.setsockopt(zmq.IMMEDIATE, 1)
            monitor = dealer.get_monitor_socket(zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_SUCCEEDED)
            dealer.connect(f"tcp://127.0.0.1:{tcp_port}")
            events = await asyncio.to_thread(monitor.recv_multipart)
            assert int.from_bytes(events[0][:2], "little") == zmq.EVENT_DISCONNECTED
            dealer.disable_monitor()
            monitor.close(linger=0)
        assert (await one["uav1"].traffic()).received_frames == 0


@on_uvloop
async def test_member_cannot_start_frames_in_name_of_another(tmp_path: Path) -> None:
    names = ("uav1", "uav2", "uav3")
    tcp_port = free_port()
    async with swarm(tmp_path, *names, settings={"uav1": {"tcp_port": tcp_port}}) as cell:
        await cell["uav1"].until_up("uav2", "uav3")
        box = cell["uav1"].app.inbox("cmd/note", Text)
        forged = Frame(
            FrameKind.MESSAGE,
            data_id("cmd/note", "Text"),
            hardware_id("uav3"),
            1,
            hardware_id("uav1"),
            payload=b"\x91\xa4fake",
        )
        keys = Keys.load(tmp_path / "keys" / "uav2", "uav2")
        server = keys.curve_of("uav1")
        assert server is not None
        with zmq.Context() as context, context.socket(zmq.DEALER) as dealer:
            dealer.setsockopt(zmq.LINGER, 0)
            dealer.setsockopt(zmq.CURVE_SERVERKEY, server)
            dealer.setsockopt(zmq.CURVE_PUBLICKEY, keys.curve_public)
            dealer.setsockopt(zmq.CURVE_SECRETKEY, keys.curve_secret)
            dealer.connect(f"tcp://127.0.0.1:{tcp_port}")
            dealer.send(encode(forged))
            traffic = await cell["uav1"].until_counted(lambda traffic: traffic.refused.spoofed == 1)
        assert len(box) == 0
        assert traffic.received_frames == 1


@on_uvloop
async def test_a_flood_of_a_stranger_costs_no_link(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        await pair["uav1"].until_up("uav2")
        address = ("239.83.87.1", pair["uav1"].group_port)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
            for index in range(20_000):
                hw = hardware_id("uav2") if index % 2 else index
                sock.sendto(b"\x54\x20" + hw.to_bytes(4, "little") + bytes(200), address)
                if index % 50 == 0:
                    await asyncio.sleep(0.002)
        traffic = await pair["uav1"].until_counted(lambda traffic: traffic.refused.flooded > 5000)
        assert pair["uav1"].states() == {"uav2": "up"}
        assert traffic.refused.unknown_session + traffic.refused.forged < 2000


GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01" + b"CURVE".ljust(20, b"\0") + bytes(32)
"""Of a client, as RFC 23 and 26 of ZeroMQ have it."""


@pytest.mark.parametrize(
    ("sent", "stays"),
    [
        (b"", True),
        (bytes(range(256)) * 4, False),
        (GREETING, True),
        (GREETING.replace(b"CURVE", b"NULL\0"), False),
        (GREETING + b"\x06" + (2000).to_bytes(8, "big") + b"\x05HELLO" + bytes(1500), True),
    ],
    ids=["nothing", "garbage", "greeting", "greeting without keys", "half a command"],
)
def test_500_keyless_connections_are_limited_and_member_passes(
    tmp_path: Path, sent: bytes, stays: bool
) -> None:
    opened = 500
    denied = opened - HALF_OPEN_MAX if stays else opened - 1

    @on_uvloop
    async def run() -> None:
        loop = asyncio.get_running_loop()
        port = free_port()
        async with swarm(tmp_path, "uav1", "uav2", settings={"uav1": {"tcp_port": port}}) as pair:
            await pair["uav2"].until_up("uav1")
            box = pair["uav1"].app.inbox("cmd/note", Text)
            with ExitStack() as held:
                for _ in range(opened):
                    sock = held.enter_context(socket.socket())
                    sock.setblocking(False)
                    await loop.sock_connect(sock, ("127.0.0.1", port))
                    sock.send(sent)
                for number in range(3):
                    outcome = await pair["uav2"].app.send(
                        "/uav1/cmd/note", Text(str(number)), timeout_s=PATIENCE_S
                    )
                    assert outcome, outcome
                traffic = await pair["uav1"].until_counted(
                    lambda traffic: traffic.refused.denied_connections >= denied
                )
                assert traffic.refused.denied_connections <= opened
            assert len(box) == 3

    run()


@on_uvloop
async def test_without_keys_nobody_outside_this_computer_is_served(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2", keys=False, bind_address="0.0.0.0") as pair:
        await pair["uav1"].until_up("uav2")
        table = pair["uav1"].neighbours.value
        assert table is not None
        assert table.neighbours[0].address.startswith("127.0.0.1:")


@on_uvloop
async def test_mismatched_keys_end_broker_with_reason(tmp_path: Path) -> None:
    make_swarm(tmp_path / "keys", ["uav1", "uav2"])
    shutil.copytree(tmp_path / "keys" / "uav2", tmp_path / "other")
    folder = make_node(
        tmp_path, "uav1", services={"broker": Config(udp_port=free_port())}, keys_dir=str(tmp_path / "other")
    )
    station = Station(folder)
    try:
        await station.open()
        with pytest.raises(Denied, match="not the key that the roster has for uav1"):
            await asyncio.wait_for(station.ended(), 10)
    finally:
        await station.close()


@on_uvloop
async def test_seeds_join_where_there_is_no_multicast(tmp_path: Path) -> None:
    port = free_port()
    async with swarm(
        tmp_path,
        "uav1",
        "uav2",
        "uav3",
        multicast_group="",
        settings={
            "uav1": {"unicast_port": port},
            "uav2": {"seeds": (f"127.0.0.1:{port}",)},
            "uav3": {"seeds": (f"localhost:{port}",)},
        },
    ) as star:
        await star["uav1"].until_up("uav2", "uav3")
        await star["uav2"].until_reaches(uav3="uav1")
        table = star["uav2"].neighbours.value
        assert table is not None
        assert [(n.platform, n.multicast) for n in table.neighbours] == [("uav1", False)]
        box = star["uav3"].app.inbox("cmd/note", Text)
        outcome = await star["uav2"].app.send("/uav3/cmd/note", Text("over the seed"), timeout_s=PATIENCE_S)
        assert outcome.delivered
        assert (await anext(box)).value == "over the seed"
