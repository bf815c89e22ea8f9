"""Real processes of one node: boards, streams, messages and requests between them, killed and restarted."""

import asyncio
import signal
import time
from collections.abc import Iterator
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer, NotFound, SwarmError, TypeMismatch
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import Process, run_python
from swarmware.testing.tmpnode import make_node
from swarmware.transport.delivery import outbox
from swarmware.transport.delivery.outcome import Status
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.scalar import Float, Int, Text
from swarmware.types.vehicle import Pose

ACTORS = str(Path(__file__).with_name("actors.py"))
EXAMPLES = Path(__file__).parents[3] / "share/swarm/examples"


@pytest.fixture
def config_dir(tmp_path: Path) -> Iterator[Path]:
    folder = make_node(tmp_path)
    with no_leaks(tmp_path):
        yield folder


def actor(name: str, config_dir: Path, *args: str) -> AbstractAsyncContextManager[Process]:
    return run_python(ACTORS, name, str(config_dir), *args)


def test_board_and_stream_of_another_process_are_read(config_dir: Path) -> None:
    async def run() -> None:
        async with Module("test", config_dir=config_dir) as m:
            # opened before there is a writer: no start order
            pose = m.reader("nav/pose", Pose)
            steps = m.stream_reader("plan/steps", Int)
            assert (pose.value, pose.age_s) == (None, None)
            async with actor("publish", config_dir) as publisher:
                assert await publisher.line() == "ready"
                first = await pose.changed(PATIENCE_S)
                assert (await pose.changed(PATIENCE_S)).x_m > first.x_m
                alive, age_s = pose.alive, pose.age_s
                assert alive
                assert age_s is not None
                assert 0 <= age_s < 5
                numbers = [(await steps.next(PATIENCE_S)).value for _ in range(50)]
                assert numbers == list(range(numbers[0], numbers[0] + 50))
                assert numbers[0] == 1, "a stream opened before its writer misses nothing"
                assert steps.lost == 0
                assert await publisher.terminate() == 0
            assert not pose.alive
            assert pose.value is not None, "the last value stays with its reader"

    asyncio.run(run())


def test_killed_writer_returns_to_same_readers(config_dir: Path) -> None:
    async def run() -> None:
        async with Module("test", config_dir=config_dir) as m:
            pose = m.reader("nav/pose", Pose)
            for _ in range(3):
                async with actor("publish", config_dir) as publisher:
                    await publisher.line()
                    await pose.changed(PATIENCE_S)
                    sequence = pose.sequence
                    await publisher.kill()
                assert not pose.alive
                assert pose.value is not None
                assert pose.sequence >= sequence

    asyncio.run(run())


def test_a_message_is_delivered_and_acknowledged(config_dir: Path) -> None:
    async def run() -> None:
        async with Module("test", config_dir=config_dir) as m, actor("receive", config_dir) as receiver:
            # sent before the receiver is there
            outcome = await m.send("cmd/goto", Goal(7, GoalKind.GOTO), timeout_s=PATIENCE_S)
            while not outcome:
                outcome = await m.send("cmd/goto", Goal(7, GoalKind.GOTO), timeout_s=PATIENCE_S)
            assert outcome.where == "uav1:receiver#1"
            assert abs(outcome.received_ns - m.now_ns()) < 10e9
            assert [await receiver.line(), await receiver.line()] == ["ready", "goal 7"]

    asyncio.run(run())


def test_sender_learns_that_receiver_was_killed(config_dir: Path) -> None:
    async def run() -> None:
        async with Module("test", config_dir=config_dir) as m, actor("hoard", config_dir) as receiver:
            await receiver.line()
            for number in range(2):
                assert await m.send("cmd/goto", Goal(number, GoalKind.GOTO))
            waiting = asyncio.create_task(m.send("cmd/goto", Goal(3, GoalKind.GOTO), timeout_s=PATIENCE_S))
            await asyncio.sleep(0.1)
            assert not waiting.done(), "a full inbox is waited for"
            began_s = time.monotonic()
            await receiver.kill()
            outcome = await waiting
            assert outcome.status is Status.UNREACHABLE
            assert (outcome.where, outcome.detail) == ("uav1", "the receiver has ended without an answer")
            assert time.monotonic() - began_s < 20, "told long before its time is over"

    asyncio.run(run())


def test_receiver_restarted_within_time_gets_message(
    config_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outbox, "GRACE_NS", round(PATIENCE_S * 1e9))  # the computer may be busy

    async def run() -> None:
        async with Module("test", config_dir=config_dir) as m, actor("relieve", config_dir) as relief:
            assert await relief.line() == "waiting"
            async with actor("hoard", config_dir) as receiver:
                await receiver.line()
                for number in range(2):
                    assert await m.send("cmd/goto", Goal(number, GoalKind.GOTO))
                waiting = asyncio.create_task(
                    m.send("cmd/goto", Goal(3, GoalKind.GOTO), timeout_s=PATIENCE_S)
                )
                await asyncio.sleep(0.05)
                await receiver.kill()
                relief.signal(signal.SIGUSR1)
            assert await relief.line() == "ready"
            assert (await waiting).delivered
            assert await relief.line() == "goal 3"

    asyncio.run(run())


def test_many_messages_into_small_inbox_all_arrive_once(config_dir: Path) -> None:
    async def run() -> None:
        async with actor("receive", config_dir) as receiver:
            await receiver.line()
            async with actor("flood", config_dir, "200") as flooder:
                assert await flooder.line() == "delivered 200"
                assert await flooder.wait() == 0
            numbers = [int((await receiver.line()).split()[1]) for _ in range(200)]
            assert sorted(numbers) == list(range(200))

    asyncio.run(run())


def test_unfitting_value_is_refused_with_reason(config_dir: Path) -> None:
    async def run() -> None:
        async with Module("test", config_dir=config_dir) as m, actor("receive", config_dir) as receiver:
            await receiver.line()
            outcome = await m.send("cmd/goto", Pose(1.0, 2.0))
            assert outcome.status is Status.REFUSED
            assert "takes Goal" in outcome.detail
            outcome = await m.send("cmd/nowhere", Pose(1.0, 2.0))
            assert outcome.status is Status.REFUSED
            damaged = await m.send("cmd/goto", Goal(1, kind=5))  # type: ignore[arg-type]
            assert damaged.status is Status.REFUSED
            assert damaged.where == "uav1:receiver#1"
            assert "$[1]" in damaged.detail

    asyncio.run(run())


def test_requests_are_answered_and_errors_keep_their_class(config_dir: Path) -> None:
    async def run() -> None:
        async with Module("test", config_dir=config_dir) as m, actor("serve", config_dir) as server:
            await server.line()
            assert await m.request("sys/double", Int(21), Int) == Int(42)
            with pytest.raises(NotFound, match="number -1: none such"):
                await m.request("sys/double", Int(-1), Int)
            with pytest.raises(SwarmError, match="IndexError"):
                await m.request("sys/broken", Text("x"), Text)
            with pytest.raises(TypeMismatch, match="takes Int"):
                await m.request("sys/double", Float(1.0), Int)
            with pytest.raises(NotFound, match="sys/nothing"):
                await m.request("sys/nothing", Int(1), Int)
            assert await m.request("sys/slow", Int(700), Int) == Int(700), "sent again, worked on once"
            with pytest.raises(NoAnswer):
                await m.request("sys/slow", Int(5000), Int, timeout_s=0.3)
            answers = await asyncio.gather(*(m.request("sys/double", Int(i), Int) for i in range(300)))
            assert [answer.value for answer in answers] == [2 * i for i in range(300)]

    asyncio.run(run())


def test_another_platform_is_unreachable_without_a_broker(config_dir: Path) -> None:
    async def run() -> None:
        async with Module("test", config_dir=config_dir) as m:
            outcome = await m.send("/uav9/cmd/goto", Goal(1, GoalKind.GOTO), timeout_s=0.5)
            assert outcome.status is Status.UNREACHABLE
            assert "no broker" in outcome.detail
            with pytest.raises(NoAnswer, match="no broker"):
                await m.request("/uav9/sys/double", Int(1), Int, timeout_s=0.5)

    asyncio.run(run())


def test_the_smallest_module_of_the_examples_works(config_dir: Path) -> None:
    async def run() -> None:
        example = str(EXAMPLES / "hello.py")
        async with Module("test", config_dir=config_dir) as m:
            pose = m.writer("nav/pose", Pose)
            pose.write(Pose(0.0, 8.0))
            path = m.stream_reader("plan/path", Pose)
            async with run_python(example, env={"SWARM_CONFIG": str(config_dir)}) as hello:
                while not await m.send("cmd/goto", Goal(1, GoalKind.GOTO, x_m=4.0), timeout_s=PATIENCE_S):
                    assert hello.returncode is None, hello.stderr()
                steps = [await path.next(PATIENCE_S) for _ in range(4)]
            assert [(step.x_m, step.y_m) for step in steps] == [(1, 6), (2, 4), (3, 2), (4, 0)]

    asyncio.run(run())
