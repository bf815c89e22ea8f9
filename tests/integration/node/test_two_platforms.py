"""Two platforms in one process, their broker a pair of callbacks: remote messages, mirrors, stamps."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
import zmq
from tests.patience import PATIENCE_S

from swarmware.errors import InvalidInput, NoAnswer
from swarmware.model import names
from swarmware.model.frame import Codec, Frame, FrameKind, decode, encode
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.testing.leaks import no_leaks
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.delivery.outcome import Status
from swarmware.types import registry
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.scalar import Float, Int
from swarmware.types.time import Conversion, TimeFunctions
from swarmware.types.vehicle import Pose


class Pair(NamedTuple):
    near: Module
    far: Module
    cut: Callable[[], None]


@asynccontextmanager
async def pair(root: Path) -> AsyncIterator[Pair]:
    """uav1 and uav2; `cut` takes the link away."""
    open_ = [True]

    def link(here: Node, there: Node) -> Callable[[Frame], None]:
        def carry(frame: Frame) -> None:
            if open_ and frame.receiver_hw == there.hardware:
                there.messaging.deliver(decode(encode(frame)))  # as bytes, as between machines
            else:
                here.messaging.refuse(frame, Status.UNREACHABLE, "no route")

        return carry

    async with tmp_node(root, "uav1") as one, tmp_node(root, "uav2", clock={"offset_s": 5.0}) as two:
        one.messaging.set_gateway(link(one, two))
        two.messaging.set_gateway(link(two, one))
        async with Module("near", node=one) as near, Module("far", node=two) as far:
            yield Pair(near, far, open_.clear)


def test_messages_and_requests_cross_between_platforms(tmp_path: Path) -> None:
    async def run() -> None:
        async with pair(tmp_path) as (near, far, cut):
            inbox = far.inbox("cmd/goto", Goal)
            far.serve("sys/double", Int, lambda request, meta: Int(request.value * 2))
            for number in range(10):
                outcome = await near.send("/uav2/cmd/goto", Goal(number, GoalKind.GOTO))
                assert outcome.delivered
                assert outcome.where == "uav2:far#1"
                assert (await inbox.next(PATIENCE_S)).seq == number
                assert inbox.meta is not None
                assert inbox.meta.sender_hw == near.node.hardware
            assert await near.request("/uav2/sys/double", Int(4), Int, timeout_s=PATIENCE_S) == Int(8)
            # the own platform may be named, too
            assert await far.request("/uav2/sys/double", Int(4), Int, timeout_s=PATIENCE_S) == Int(8)

            refused = await near.send("/uav2/cmd/goto", Pose(0, 0), timeout_s=1.5)
            assert (refused.status, refused.where) == (Status.REFUSED, "uav2")
            nobody = await near.send("/uav7/cmd/goto", Goal(1, GoalKind.GOTO), timeout_s=0.5)
            assert (nobody.status, nobody.where, nobody.detail) == (Status.UNREACHABLE, "uav1", "no route")

            cut()
            lost = await near.send("/uav2/cmd/goto", Goal(1, GoalKind.GOTO), timeout_s=0.5)
            assert lost.status is Status.UNREACHABLE
            with pytest.raises(NoAnswer, match="no route"):
                await near.request("/uav2/sys/double", Int(4), Int, timeout_s=0.5)

    with no_leaks(tmp_path):
        asyncio.run(run())


def test_full_inbox_of_another_platform_is_waited_for(tmp_path: Path) -> None:
    async def run() -> None:
        async with pair(tmp_path) as (near, far, _):
            inbox = far.inbox("cmd/goto", Goal, limit=1)
            first = await near.send("/uav2/cmd/goto", Goal(1, GoalKind.GOTO))
            assert first
            expired = await near.send("/uav2/cmd/goto", Goal(2, GoalKind.GOTO), timeout_s=0.7)
            assert expired.status is Status.EXPIRED
            waiting = asyncio.create_task(
                near.send("/uav2/cmd/goto", Goal(3, GoalKind.GOTO), timeout_s=PATIENCE_S)
            )
            await asyncio.sleep(0)  # it is sent
            assert [(await inbox.next(PATIENCE_S)).seq, (await inbox.next(PATIENCE_S)).seq] == [1, 3]
            assert (await waiting).delivered

    asyncio.run(run())


def test_mirrors_appear_in_a_set_of_boards(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node, Module("test", node=node) as m:
            poses = m.readers("/*/nav/pose", Pose)
            one = m.reader("/uav3/nav/pose", Pose)
            assert dict(poses) == {}
            await asyncio.sleep(0)
            assert set(m.entry.reads) == {"/*/nav/pose", "/uav3/nav/pose"}

            waiting = asyncio.create_task(poses.changed(PATIENCE_S))
            await asyncio.sleep(0)  # it waits
            data_id = names.data_id("nav/pose", "Pose")
            mirrors = {}
            for platform in ("uav3", "ugv1", "uav1"):
                mirrors[platform] = node.mirror_writer(platform, "nav/pose")
                pose = Pose(float(len(mirrors)), 2.0)
                frame = Frame(
                    FrameKind.BOARD,
                    data_id,
                    names.hardware_id(platform),
                    1,
                    sequence=9,
                    stamp_ns=5_000_000_000 + m.now_ns(),
                    codec=Codec.PACKED,
                    payload=pose.pack(),
                )
                mirrors[platform].publish(encode(frame))
                await asyncio.sleep(0)
            assert (await waiting)[0] == "uav3"
            assert sorted(poses) == ["uav3", "ugv1"], "the own platform is no mirror"
            values = {name: reader.value for name, reader in poses.items()}
            assert values == {"uav3": Pose(1.0, 2.0), "ugv1": Pose(2.0, 2.0)}
            assert (one.value, one.sequence) == (Pose(1.0, 2.0), 9)

            # its clock is 5 s ahead: no age until that is known
            unknown_s = one.age_s
            assert unknown_s is None
            functions = m.writer("time/functions", TimeFunctions)
            conversion = Conversion(
                "uav3", "main", names.hardware_id("uav3"), 1, 5_000_000_000, 0.0, m.now_ns(), 10, 1, 0.0, 0
            )
            functions.write(TimeFunctions("uav1", "main", 1, m.now_ns(), (conversion,)))
            age_s = one.age_s
            assert age_s is not None
            assert 0 <= age_s < 5

            mirrors["ugv1"].publish(
                encode(Frame(FrameKind.BOARD, data_id, payload=registry.encode(Pose(7.0, 7.0))))
            )
            assert "ugv1" in await poses.changed(PATIENCE_S)
            assert poses["ugv1"].value == Pose(7.0, 7.0)
            for mirror in mirrors.values():
                mirror.close()

    with no_leaks(tmp_path):
        asyncio.run(run())


def test_pattern_with_wildcard_in_path_is_refused(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node, Module("test", node=node) as m:
            for pattern in ("/*/nav/*", "nav/pose", "/*"):
                with pytest.raises(InvalidInput):
                    m.readers(pattern, Pose)
            with pytest.raises(InvalidInput, match="of another platform"):
                m.writer("/uav9/nav/pose", Pose)

    asyncio.run(run())


def test_a_board_grows_and_its_reader_follows(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node, Module("test", node=node) as m:
            from swarmware.types.scalar import Text

            board = m.writer("test/text", Text)
            reader = m.reader("test/text", Text)
            for length in (10, 600, 5_000, 100_000, 20):
                board.write(Text("x" * length))
                value = reader.value
                assert value is not None
                assert len(value.value) == length
            assert reader.sequence == 5

    asyncio.run(run())


def test_board_of_another_type_is_refused_and_counted(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node, Module("test", node=node) as m:
            board = m.writer("test/number", Int)
            reader = m.reader("test/number", Float)
            board.write(Int(1))
            assert (reader.value, reader.refused) == (None, 1)
            with pytest.raises(NoAnswer):
                await reader.changed(0.05)

    asyncio.run(run())


def test_garbage_at_the_socket_is_counted_and_dropped(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node, Module("test", node=node) as m:
            inbox = m.inbox("cmd/goto", Goal)
            with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
                socket.linger = 1000
                socket.connect(node.messaging.address)
                for garbage in (b"", b"SW", bytes(48), b"SW\x01\xff" + bytes(44)):
                    socket.send(garbage)
                socket.send_multipart([b"two", b"parts"])
                good = Frame(
                    FrameKind.MESSAGE,
                    names.data_id("cmd/goto", "Goal"),
                    node.hardware,
                    1,
                    node.hardware,
                    payload=registry.encode(Goal(5, GoalKind.GOTO)),
                )
                socket.send(encode(good))
                assert (await inbox.next(PATIENCE_S)).seq == 5
            assert node.messaging.counters().malformed == 5

    with no_leaks(tmp_path):
        asyncio.run(run())
