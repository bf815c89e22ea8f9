"""The history of a board: its values as they arrive, former ones after newer ones, each once."""

import asyncio
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import data_id, hardware_id
from swarmware.module.module import Module
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.testing.tmpnode import tmp_node
from swarmware.types import registry
from swarmware.types.scalar import Float, Int

PATH, THERE = "nav/height", hardware_id("uav7")


def frame(sequence: int, kind: type[Float | Int] = Float) -> Frame:
    """A value of a board that its owner wrote at second `sequence`."""
    return Frame(
        FrameKind.BOARD,
        data_id(PATH, kind.__name__),
        THERE,
        sequence=sequence,
        stamp_ns=sequence * 1_000_000_000,
        payload=registry.encode(kind(sequence)),
    )


async def test_live_and_former_values_keep_newest_board(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        history, board = m.history(f"/uav7/{PATH}", Float), m.reader(f"/uav7/{PATH}", Float)
        assert history.take() is None
        writer, found = MirrorWriter(node), []
        for sequence, is_late in ((1, False), (9, False), (8, True), (10, False), (7, True)):
            write = writer.write_late if is_late else writer.write
            write("uav7", PATH, frame(sequence), epoch=1)
            value = await history.next(PATIENCE_S)
            assert history.meta is not None
            found.append((value.value, history.meta.stamp_ns // 1_000_000_000))
        assert found == [(1, 1), (9, 9), (8, 8), (10, 10), (7, 7)]
        assert board.value == Float(10.0)
        assert history.lost == 0, "a gap of the numbers is what still comes"
        writer.close()


async def test_a_value_that_comes_again_is_returned_once(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        history, writer = m.history(f"/uav7/{PATH}", Float), MirrorWriter(node)
        writer.write("uav7", PATH, frame(1), epoch=1)
        assert history.take() == Float(1.0)
        for sequence in (1, 0, 0):
            writer.write_late("uav7", PATH, frame(sequence), epoch=1)
        assert [history.take(), history.take()] == [Float(0.0), None]
        writer.close()


async def test_mistyped_values_are_refused_in_both_mirrors(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        history, writer = m.history(f"/uav7/{PATH}", Float), MirrorWriter(node)
        writer.write("uav7", PATH, frame(1, Int), epoch=1)
        writer.write_late("uav7", PATH, frame(0, Int), epoch=1)
        assert history.take() is None
        assert history.refused == 2
        with pytest.raises(NoAnswer, match=PATH):
            await history.next(0.0)
        writer.close()


async def test_reader_that_waits_wakes_for_former_value_too(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        frames = m.frame_reader(f"/uav7/{PATH}", history=True)
        waiting = asyncio.ensure_future(anext(frames))
        await asyncio.sleep(0)
        writer = MirrorWriter(node)
        writer.write_late("uav7", PATH, frame(4), epoch=1)
        async with asyncio.timeout(PATIENCE_S):
            assert (await waiting).sequence == 4
        assert frames.lost == 0
        writer.close()


async def test_local_board_returns_each_value(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("pilot", node=node) as m:
        history, writer = m.history(PATH, Float), m.writer(PATH, Float)
        for number in range(3):
            writer.write(Float(number))
        assert [history.take() for _ in range(4)] == [Float(0.0), Float(1.0), Float(2.0), None]
