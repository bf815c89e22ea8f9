"""Hostile frames, a thousand of each: none reaches an application, journal and doctor show them."""

import asyncio
import logging
import socket
from collections.abc import Iterable
from pathlib import Path

import msgspec
import pytest
import zmq
from tests.integration.broker.hostile import PATH, TRIES, dealer, found_by_doctor, order
from tests.integration.broker.swarm import LINE, Station, on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmd.broker.core.swarm.neighbours.medium_table import Use
from swarmd.broker.exchange.carriers.frame_datagrams import FrameDatagrams
from swarmd.broker.exchange.carriers.zmq_links import ZmqLinks
from swarmware.model.frame import FrameKind, decode, encode
from swarmware.model.names import hardware_id
from swarmware.transport.delivery import signature
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import make_swarm
from swarmware.types import registry
from swarmware.types.net import Denial
from swarmware.types.scalar import Text
from swarmware.types.traffic import Refused

REFUSED = "refused"
"""Check of `swarmctl doctor` on what the broker refused."""
NAMES = ("uav1", "uav2", "uav3")


def denied_lines(caplog: pytest.LogCaptureFixture, reason: str) -> list[str]:
    """Lines of the journal about a denial: some, and not one for each try."""
    lines = [line for line in caplog.messages if line.startswith(f"denied: {reason}")]
    assert len(lines) < TRIES / 10
    return lines


def all_refused(refused: Refused, *names: str) -> bool:
    """Whether these counters have all tries."""
    total: int = sum(msgspec.structs.asdict(refused)[name] for name in names)
    return total >= TRIES


async def send_all(
    keys: Keys, port: int, frames: Iterable[bytes], station: Station, *counters: str
) -> Refused:
    """Sends frames over a connection with these keys; returns the counters when all were refused."""
    server = keys.curve_of("uav1")
    assert server is not None
    async with dealer(keys, server, port) as connection:
        for data in frames:
            connection.send(data)
        traffic = await station.until_counted(lambda traffic: all_refused(traffic.refused, *counters))
    return traffic.refused


@on_uvloop
async def test_member_speaks_for_no_other_and_repeats_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    recorded: list[bytes] = []
    send = ZmqLinks.send

    def record(links: ZmqLinks, peer: LinkPeer, queued: QueuedFrame) -> list[QueuedFrame]:
        frame = queued.frame
        if peer.platform == "uav1" and frame.kind is FrameKind.MESSAGE and frame.hops_left < 24:
            recorded.append(queued.data)
        return send(links, peer, queued)

    monkeypatch.setattr(ZmqLinks, "send", record)
    port = free_port()
    # the relay sends what is recorded over its connection, also when its link was measured meanwhile
    settings: dict[str, dict[str, object]] = {"uav1": {"tcp_port": port}, "uav2": {"frames": "tcp"}}
    async with swarm(tmp_path, *NAMES, hear=LINE, settings=settings) as line:
        owner, far = line["uav1"], line["uav3"]
        box = owner.app.inbox(PATH, Text)
        denials = owner.app.stream_reader("net/denials", Denial)
        await far.until_reaches(uav1="uav2")
        await owner.until_reaches(uav3="uav2")
        assert await far.app.send("/uav1/cmd/note", Text("genuine"), timeout_s=1.0)
        assert (await box.next(PATIENCE_S)).value == "genuine"
        [genuine] = recorded[:1]
        relay, forger = (Keys.load(tmp_path / "keys" / name, name) for name in ("uav2", "uav2"))
        own_session = signature.split(decode(genuine).extension).signature
        assert own_session is not None

        def forged() -> Iterable[bytes]:
            for number in range(TRIES):
                frame = order("uav3", number, owner.app.now_ns(), hops=23 if number % 4 else 24)
                if number % 4 == 1:  # its own signature, in its own name
                    frame.extension = signature.signed_extension(
                        frame, hardware_id("uav2"), own_session.session, forger.sign
                    )
                elif number % 4 == 2:  # its own signature, in the name of the sender
                    frame.extension = signature.signed_extension(
                        frame, hardware_id("uav3"), own_session.session, forger.sign
                    )
                elif number % 4 == 3 and number % 8 == 3:  # the genuine frame with another content
                    changed = msgspec.structs.replace(decode(genuine), payload=registry.encode(Text("other")))
                    yield encode(changed)
                    continue
                yield encode(frame)

        refused = await send_all(relay, port, forged(), owner, "spoofed", "unsigned")
        assert refused.spoofed + refused.unsigned == TRIES
        assert refused.unsigned == TRIES // 8
        denial = await denials.next(PATIENCE_S)
        assert (denial.platform, denial.verb, denial.path) == ("uav2", "forward", PATH)
        assert denied_lines(caplog, "frame of uav3: ")
        found = await found_by_doctor(owner, REFUSED)
        assert found.verdict == "warning"
        assert f"{refused.spoofed} spoofed, {refused.unsigned} unsigned" in found.text
        source = await found_by_doctor(owner, "denied")
        assert source.text.startswith(f"operator@uav2: {PATH}: ")
        assert "revoke it" in source.advice

        # within its lifetime the recorded frame is a duplicate; later it is refused
        server = relay.curve_of("uav1")
        assert server is not None
        async with dealer(relay, server, port) as connection:
            sent = 0
            while (await owner.traffic()).refused.replayed < TRIES:
                for _ in range(50):
                    connection.send(genuine)
                sent += 50
                await asyncio.sleep(0)
                assert sent < 100 * TRIES
        assert len(box) == 0
        await owner.until_counted(lambda traffic: traffic.refused.replayed >= TRIES)
        assert " replayed" in (await found_by_doctor(owner, REFUSED)).text
        assert denied_lines(caplog, "frame of uav3: made long ago; a replay, or delayed")
        assert await far.app.send("/uav1/cmd/note", Text("next"), timeout_s=PATIENCE_S)
        assert (await box.next(PATIENCE_S)).value == "next"


@on_uvloop
async def test_expired_command_and_observer_that_sets_are_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    port = free_port()
    roles = {"uav1": "node", "uav2": "observer", "gcs": "operator"}
    async with swarm(tmp_path, *roles, roles=roles, settings={"uav1": {"tcp_port": port}}) as cell:
        owner = cell["uav1"]
        box = owner.app.inbox(PATH, Text)
        await owner.until_up("uav2", "gcs")
        late = (
            order("gcs", n, cell["gcs"].app.now_ns() - 10**9, life_s=0.1 + n % 800 / 1000)
            for n in range(TRIES)
        )
        keys = Keys.load(tmp_path / "keys" / "gcs", "gcs")
        assert (await send_all(keys, port, map(encode, late), owner, "expired")).expired == TRIES
        assert denied_lines(caplog, f"{PATH}: of gcs, arrived after its lifetime")
        assert f"{TRIES} expired" in (await found_by_doctor(owner, REFUSED)).text
        case = await found_by_doctor(owner, "denied")
        assert case.text.startswith(f"operator@gcs: {PATH}: ")
        assert "arrived after its lifetime" in case.text
        assert "role" not in case.advice, "its role is not the reason"
        keys = Keys.load(tmp_path / "keys" / "uav2", "uav2")
        now_ns = cell["uav2"].app.now_ns()
        denied = (order("uav2", n, now_ns, life_s=60.0) for n in range(TRIES))
        assert (await send_all(keys, port, map(encode, denied), owner, "denied")).denied == TRIES
        assert len(box) == 0
        assert await cell["gcs"].app.send("/uav1/cmd/note", Text("genuine"), timeout_s=PATIENCE_S)


@on_uvloop
async def test_a_replayed_datagram_and_a_stranger_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    recorded: list[tuple[LinkPeer, bytes]] = []
    put = FrameDatagrams._put

    def record(datagrams: FrameDatagrams, peer: LinkPeer, datagram: bytes, use: Use) -> bool:
        recorded.append((peer, datagram))
        return put(datagrams, peer, datagram, use)

    monkeypatch.setattr(FrameDatagrams, "_put", record)
    port = free_port()
    async with swarm(tmp_path, "uav1", "gcs", settings={"uav1": {"tcp_port": port}}) as pair:
        owner, gcs = pair["uav1"], pair["gcs"]
        box = owner.app.inbox(PATH, Text)
        await gcs.until_up("uav1")
        await owner.until_up("gcs")
        assert await gcs.app.send("/uav1/cmd/note", Text("genuine"), timeout_s=PATIENCE_S, urgent=True)
        assert (await box.next(PATIENCE_S)).value == "genuine"
        peer, datagram = next(one for one in recorded if one[0].platform == "uav1")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            for number in range(TRIES):
                sock.sendto(datagram, (peer.host, peer.frame_port))
                if number % 50 == 0:
                    await asyncio.sleep(0.002)
        traffic = await owner.until_counted(lambda traffic: traffic.refused.replayed >= TRIES)
        assert traffic.refused.replayed == TRIES
        assert f"{TRIES} replayed" in (await found_by_doctor(owner, REFUSED)).text
        assert any("refused input: " in line and "replayed" in line for line in caplog.messages)

        make_swarm(tmp_path / "strangers", {"gcs": "maintainer"})
        stranger = Keys.load(tmp_path / "strangers" / "gcs", "gcs")
        server = Keys.load(tmp_path / "keys" / "gcs", "gcs").curve_of("uav1")
        assert server is not None
        before = traffic.received_frames
        async with dealer(stranger, server, port) as connection:
            for number in range(TRIES):
                connection.send(encode(order("gcs", number, owner.app.now_ns())), zmq.NOBLOCK)
            traffic = await owner.until_counted(lambda traffic: traffic.refused.denied_connections >= 1)
        assert traffic.received_frames == before
        assert len(box) == 0


@on_uvloop
async def test_command_of_unknown_clock_waits_for_its_beacon(tmp_path: Path) -> None:
    port = free_port()
    make_swarm(tmp_path / "keys", dict.fromkeys(("uav1", "gcs"), "operator"))
    async with swarm(tmp_path, "uav1", keys=False, settings={"uav1": {"tcp_port": port}}) as alone:
        owner = alone["uav1"]
        box = owner.app.inbox(PATH, Text)
        keys = Keys.load(tmp_path / "keys" / "gcs", "gcs")
        # its beacon was never received, so that the age of what it sends is not known
        sent = (order("gcs", number, owner.app.now_ns(), life_s=60.0) for number in range(TRIES))
        refused = await send_all(keys, port, map(encode, sent), owner, "undated")
        assert refused.undated == TRIES
        assert len(box) == 0
