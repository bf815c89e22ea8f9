"""The first attempt of an urgent frame is one sealed datagram; whatever becomes of it, it arrives once."""

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from random import Random

import pytest
from tests.integration.broker.swarm import LINE, Station, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmd.broker.core.beacon.beacon import Hello
from swarmd.broker.core.beacon.hello_schedule import HelloSchedule, Moment
from swarmd.broker.core.frames.frame_datagram import FRAME, encode_header
from swarmd.broker.core.frames.reliable.reliable_links import ReliableLinks
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmd.broker.core.swarm.neighbours.medium_table import Use
from swarmd.broker.exchange.carriers.frame_datagrams import FrameDatagrams
from swarmd.broker.exchange.carriers.zmq_links import ZmqLinks
from swarmware.errors import Denied, NotFound
from swarmware.model.frame import Frame
from swarmware.model.names import data_id
from swarmware.types.scalar import Text
from swarmware.types.traffic import Refused

PATH = "cmd/note"
NOISE = Random(1)
"""Source of bytes that cannot be compressed."""


CARRIER = "tcp"
"""Else late beacons, where the processor is short, turn connections into packets, which are datagrams too."""


class Wire:
    """What leaves as datagrams of urgent frames, without the packets in which a slow computer repeats them;
    no datagram to a lossy platform leaves."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.sent: list[tuple[str, tuple[str, int], bytes]] = []
        self.lossy: frozenset[str] = frozenset()
        put = FrameDatagrams._put

        def watched(datagrams: FrameDatagrams, peer: LinkPeer, datagram: bytes, use: Use) -> bool:
            if use is Use.URGENT:
                self.sent.append((peer.platform, (peer.host, peer.frame_port), datagram))
            return peer.platform in self.lossy or put(datagrams, peer, datagram, use)

        monkeypatch.setattr(FrameDatagrams, "_put", watched)

    def to(self, platform: str) -> list[bytes]:
        return [datagram for name, _, datagram in self.sent if name == platform]

    def port_of(self, platform: str) -> int:
        return next(address[1] for name, address, _ in self.sent if name == platform)


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    return Wire(monkeypatch)


async def serve(station: Station) -> list[str]:
    """Answers requests, and waits until the broker knows their path; the list has the handled requests."""
    taken: list[str] = []

    def handle(text: Text, _meta: object) -> Text:
        taken.append(text.value)
        return Text(f"{text.value} taken")

    station.app.serve(PATH, Text, handle, reply=Text)
    table = station.node.table
    async with asyncio.timeout(PATIENCE_S):
        while table.serving_path(PATH) is None:
            await asyncio.sleep(0)
            table.refresh()
    return taken


@asynccontextmanager
async def serving_pair(
    root: Path, role: str = "operator"
) -> AsyncIterator[tuple[dict[str, Station], list[str]]]:
    """A ground station of this role and uav1, which answers its requests; returns the handled requests."""
    async with swarm(root, "gcs", "uav1", roles={"gcs": role}, frames=CARRIER) as pair:
        await pair["gcs"].until_up("uav1")
        await pair["uav1"].until_up("gcs")
        yield pair, await serve(pair["uav1"])


async def ask(station: Station, platform: str, text: str, timeout_s: float = PATIENCE_S) -> str:
    answer = await station.app.request(
        f"/{platform}/{PATH}", Text(text), Text, timeout_s=timeout_s, urgent=True
    )
    return answer.value


async def refused(station: Station) -> Refused:
    return (await station.traffic()).refused


@on_uvloop
async def test_urgent_request_takes_datagrams_and_no_connection(
    tmp_path: Path, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with serving_pair(tmp_path) as (pair, taken):
        monkeypatch.setattr(ZmqLinks, "send", lambda *_: [])  # what takes a connection is lost
        text = "go " * 1200  # 3.6 kB, as the order of a mission: compressed it fits one datagram
        assert await ask(pair["gcs"], "uav1", text) == f"{text} taken"
        assert taken == [text]
        assert len(wire.to("uav1")) == len(wire.to("gcs")) == 1
        assert all(len(datagram) <= 1238 for _, _, datagram in wire.sent)


@on_uvloop
async def test_packets_of_a_batch_leave_at_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ReliableLinks, "uses_datagrams", lambda *_: True)
    async with serving_pair(tmp_path) as (pair, taken):
        station, left = pair["gcs"], list[Use]()
        put = FrameDatagrams._put

        def watched(datagrams: FrameDatagrams, peer: LinkPeer, datagram: bytes, use: Use) -> bool:
            left.append(use)
            return put(datagrams, peer, datagram, use)

        with monkeypatch.context() as patch:
            patch.setattr(FrameDatagrams, "_put", watched)
            with station.node.messaging.batch():
                comes = [asyncio.ensure_future(ask(station, "uav1", text)) for text in ("a", "b")]
                await asyncio.sleep(0)  # each has made its frame
                assert not left
            assert Use.PACKETS in left
        assert await asyncio.gather(*comes) == ["a taken", "b taken"]
        assert taken == ["a", "b"]


@on_uvloop
async def test_request_on_clean_link_takes_datagrams(
    tmp_path: Path, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ReliableLinks, "is_clean", lambda *_: True)
    async with serving_pair(tmp_path) as (pair, taken):
        with monkeypatch.context() as patch:
            patch.setattr(ZmqLinks, "send", lambda *_: [])  # what takes a connection is lost
            await pair["gcs"].app.request(f"/uav1/{PATH}", Text("calm"), Text, timeout_s=PATIENCE_S)
            assert taken == ["calm"]
            assert len(wire.to("uav1")) == len(wire.to("gcs")) == 1
        box = pair["uav1"].app.inbox("plan/share", Text)
        large = NOISE.randbytes(1500).hex()
        assert await pair["gcs"].app.send("/uav1/plan/share", Text(large), timeout_s=PATIENCE_S)
        assert box.take() == Text(large)
        assert len(wire.to("uav1")) == 1, "it does not fit a datagram"
        assert len(wire.to("gcs")) == 1, "its acknowledgement takes the same way"
        wire.lossy = frozenset({"uav1"})
        await pair["gcs"].app.request(f"/uav1/{PATH}", Text("lost"), Text, timeout_s=PATIENCE_S)
        assert taken == ["calm", "lost"], "it was repeated over the connection"
        assert len(wire.to("uav1")) == 2


@on_uvloop
async def test_other_frames_and_large_ones_take_the_connection(
    tmp_path: Path, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ReliableLinks, "is_clean", lambda *_: False)
    async with serving_pair(tmp_path) as (pair, _):
        await pair["gcs"].app.request(f"/uav1/{PATH}", Text("calm"), Text, timeout_s=PATIENCE_S)
        assert await ask(pair["gcs"], "uav1", NOISE.randbytes(1500).hex()), "too large even when compressed"
        assert wire.sent == [] or all(name == "gcs" for name, _, _ in wire.sent)


@on_uvloop
async def test_forged_replayed_and_garbage_datagrams_are_counted(tmp_path: Path, wire: Wire) -> None:
    async with swarm(tmp_path, "gcs", "uav1", "uav2", frames=CARRIER) as three:
        gcs, uav1, uav2 = (three[name] for name in ("gcs", "uav1", "uav2"))
        for station in (gcs, uav1, uav2):
            await station.until_up(*({"gcs", "uav1", "uav2"} - {station.platform}))
        taken, others = await serve(uav1), await serve(uav2)
        await ask(gcs, "uav1", "land")
        await ask(gcs, "uav2", "hold")
        recorded = wire.to("uav1")[0]
        before, before2 = await refused(uav1), await refused(uav2)
        changed = recorded[:-1] + bytes((recorded[-1] ^ 1,))
        newer = encode_header(FRAME, int.from_bytes(recorded[2:6], "little"), 0xFFFF_FFF0) + recorded[10:]
        stranger = encode_header(FRAME, 1, 1) + NOISE.randbytes(60)
        garbage = [b"", b"x", NOISE.randbytes(1200), recorded[:10]]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
            for datagram in (recorded, changed, newer, stranger, *garbage):
                attacker.sendto(datagram, ("127.0.0.1", wire.port_of("uav1")))
            attacker.sendto(recorded, ("127.0.0.1", wire.port_of("uav2")))
        found = await uav1.until_counted(lambda t: t.refused.malformed >= before.malformed + len(garbage))
        now = found.refused
        assert now.replayed == before.replayed + 2, "the changed one has a number that was used"
        assert now.forged == before.forged + 1
        assert now.unknown_session == before.unknown_session + 1
        assert now.malformed == before.malformed + len(garbage)
        await uav2.until_counted(
            lambda t: t.refused.forged + t.refused.replayed > before2.forged + before2.replayed
        )
        assert taken == ["land"]
        assert others == ["hold"]
        assert await ask(gcs, "uav1", "return") == "return taken", "it still takes what is genuine"


@on_uvloop
async def test_a_lost_datagram_is_repeated_over_the_connection(tmp_path: Path, wire: Wire) -> None:
    async with serving_pair(tmp_path) as (pair, taken):
        wire.lossy = frozenset({"uav1", "gcs"})
        for number in range(4):
            assert await ask(pair["gcs"], "uav1", str(number)) == f"{number} taken"
        assert taken == ["0", "1", "2", "3"], "each is worked on once"
        assert len(wire.to("uav1")) == 2, "after two losses in a row the connection is used at once"


@on_uvloop
async def test_node_without_port_gets_urgent_frames_by_connection(
    tmp_path: Path, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    hello = HelloSchedule.next_hello

    def without_port(hellos: HelloSchedule, at: Moment) -> Hello | None:
        hellos.frame_port = 0 if hellos.identity.platform == "uav1" else hellos.frame_port
        return hello(hellos, at)

    monkeypatch.setattr(HelloSchedule, "next_hello", without_port)
    async with serving_pair(tmp_path) as (pair, taken):
        assert await ask(pair["gcs"], "uav1", "land") == "land taken"
        assert taken == ["land"]
        assert wire.to("uav1") == []


@on_uvloop
async def test_relays_pass_urgent_frames_on_as_datagrams(tmp_path: Path, wire: Wire) -> None:
    async with swarm(tmp_path, *LINE, hear=LINE, frames=CARRIER) as line:
        await line["uav1"].until_reaches(uav3="uav2")
        await line["uav3"].until_reaches(uav1="uav2")
        taken = await serve(line["uav3"])
        assert await ask(line["uav1"], "uav3", "land") == "land taken"
        assert taken == ["land"]
        sent = iter([name for name, _, _ in wire.sent])  # of a busy computer, some of them twice
        assert all(name in sent for name in ("uav2", "uav3", "uav2", "uav1")), "there and back, hop by hop"


@on_uvloop
async def test_datagram_needs_same_right_as_frame_of_connection(tmp_path: Path, wire: Wire) -> None:
    async with serving_pair(tmp_path, role="observer") as (pair, taken):
        with pytest.raises(Denied, match=f"{PATH}: observer@gcs may not call it"):
            await ask(pair["gcs"], "uav1", "land")
        assert taken == []
        assert (await refused(pair["uav1"])).denied == 1
        assert len(wire.to("uav1")) == 1


@on_uvloop
async def test_unstated_path_receives_no_delivery(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1", roles={"gcs": "observer"}, frames=CARRIER) as pair:
        await pair["gcs"].until_up("uav1")
        taken: list[Frame] = []
        app = pair["uav1"].app
        app.node.messaging.serve_requests(
            data_id(PATH, "Text"), app.app_id, lambda frame, _: taken.append(frame)
        )
        with pytest.raises(NotFound, match="no application here takes this path"):
            await ask(pair["gcs"], "uav1", "land")
        assert taken == []
