"""The reader's end of a board: whether it is written, how old its value is, whose clock stamped it."""

import asyncio
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import data_id, hardware_id
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types import registry
from swarmware.types.scalar import Float, Int
from swarmware.types.time import Conversion, TimeFunctions

THERE = hardware_id("uav7")
SECOND = 1_000_000_000


async def test_board_is_alive_while_written(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        reader = m.reader("nav/height", Float)
        seen = [reader.alive]
        async with Module("pilot", node=node) as pilot:
            pilot.keep_boards()
            writer = pilot.writer("nav/height", Float)
            seen.append(reader.alive)
            writer.write(Float(1.0))
            seen.append(reader.alive)
        seen.append(reader.alive)
        assert reader.value == Float(1.0), "its last value stays"
        async with Module("pilot", node=node) as pilot:
            pilot.writer("nav/height", Float)
            seen.append(reader.alive)
        assert seen == [False, True, True, False, True]


async def test_remote_age_uses_owners_clock_or_unknown(
    tmp_path: Path,
) -> None:
    async with (
        tmp_node(tmp_path) as node,
        Module("planner", node=node) as m,
        Module("timesync", node=node) as timesync,
    ):
        reader = m.reader("/uav7/nav/height", Float)
        mirror = node.mirror_writer("uav7", "nav/height")
        stamp_ns = node.clock.now_ns() + 10 * SECOND - 2 * SECOND  # their clock is 10 s ahead, 2 s ago
        frame = Frame(FrameKind.BOARD, data_id("nav/height", "Float"), THERE, stamp_ns=stamp_ns)
        frame.payload = registry.encode(Float(4.0))
        mirror.publish(encode(frame))
        assert (reader.value, reader.stamp_ns, reader.age_s) == (Float(4.0), stamp_ns, None)
        assert m.remote_clocks.to_local(THERE, stamp_ns) is None
        assert m.remote_clocks.to_local(node.hardware, 7) == 7
        functions = timesync.writer("time/functions", TimeFunctions)
        theirs = Conversion("uav7", "main", THERE, 1, 10 * SECOND, 0.0, 0, 0, 0, 0.0, 1)
        functions.write(TimeFunctions("uav1", "main", 1, 0, (theirs,)))
        assert reader.age_s == pytest.approx(2.0, abs=1.0)
        assert m.remote_clocks.to_local(THERE, stamp_ns) == stamp_ns - 10 * SECOND
        mirror.close()


async def test_board_waiter_gets_new_and_replaced_writer(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        reader = m.reader("nav/height", Float)
        first = asyncio.create_task(reader.changed(PATIENCE_S))
        await asyncio.sleep(0)
        writer = m.writer("nav/height", Float)
        writer.write(Float(1.0))
        assert await first == Float(1.0)
        m.close_writer(writer)
        again = asyncio.create_task(reader.changed(PATIENCE_S))
        await asyncio.sleep(0)
        m.writer("nav/height", Float).write(Float(2.0))
        assert await again == Float(2.0)
        with pytest.raises(NoAnswer, match=r"board nav/height: no new value within 0.01 s"):
            await reader.changed(0.01)


async def test_reader_of_many_items_yields_to_others(tmp_path: Path) -> None:
    turns: list[int] = []

    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        writer = m.stream_writer("plan/path", Int)
        stream = m.stream_reader("plan/path", Int)
        box = m.inbox("cmd/step", Int, limit=200)
        for number in range(130):
            writer.write(Int(number))
            assert await m.send("cmd/step", Int(number))

        async def count() -> None:
            while True:
                turns.append(1)
                await asyncio.sleep(0)

        other = m.start(count(), "count")
        for source in (stream, box):
            before = len(turns)
            for _ in range(130):
                await source.next(PATIENCE_S)
            assert 1 <= len(turns) - before < 10, "two turns in 130 items, not one an item"
        other.cancel()


async def test_value_is_filled_in_place_unless_failed(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        stream = m.stream_reader("plan/path", Int)
        writer = m.stream_writer("plan/path", Int)
        for number, stamp_ns in ((1, 7), (2, None)):
            before_ns = node.clock.now_ns()
            payload = registry.encode(Int(number))
            with writer.loan(len(payload), stamp_ns) as place:
                place[:] = payload
            assert await stream.next(PATIENCE_S) == Int(number)
            assert stream.meta is not None
            assert stream.meta.sender_app == m.app_id
            assert stream.meta.stamp_ns == 7 if stamp_ns else stream.meta.stamp_ns >= before_ns
        with pytest.raises(ZeroDivisionError), writer.loan(8):
            raise ZeroDivisionError
        writer.write(Int(3))
        assert await stream.next(PATIENCE_S) == Int(3)
        assert (writer.sequence, stream.refused) == (3, 0)
