"""Streams with snapshots between modules: a reader that begins late or falls behind gets the state."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer
from swarmware.module.module import Module
from swarmware.module.snapshot_stream import SnapshotStream
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.scalar import Int, Text

SLOTS = 8


class Sum:
    """An owner that streams what it adds, and whose state is the sum."""

    def __init__(self, module: Module) -> None:
        self.value = 0
        self._writer = module.stream_writer("map/delta", Int, slots=SLOTS)
        module.serve_snapshots(self._writer, lambda: Text(str(self.value)))

    def add(self, *values: int) -> None:
        for value in values:
            self.value += value
            self._writer.write(Int(value))


@asynccontextmanager
async def two(tmp_path: Path) -> AsyncIterator[tuple[Sum, SnapshotStream[Int, Text]]]:
    async with (
        tmp_node(tmp_path) as node,
        Module("mapper", node=node) as owner,
        Module("planner", node=node) as reader,
    ):
        made = Sum(owner)
        made.add(100)
        yield made, reader.snapshot_stream("map/delta", Int, Text)


async def test_reader_begins_with_state_then_items(tmp_path: Path) -> None:
    async with two(tmp_path) as (owner, stream):
        assert await stream.next(PATIENCE_S) == Text("100")
        owner.add(1, 2)
        assert [await stream.next(PATIENCE_S), await stream.next(PATIENCE_S)] == [Int(1), Int(2)]
        assert (stream.lost, stream.resyncs) == (0, 1)


async def test_reader_behind_gets_state_and_counts_misses(
    tmp_path: Path,
) -> None:
    async with two(tmp_path) as (owner, stream):
        total = 0
        assert await stream.next(PATIENCE_S) == Text("100")
        owner.add(*range(3 * SLOTS))
        while not isinstance(found := await stream.next(PATIENCE_S), Text):
            total += found.value
        assert found == Text(str(owner.value))
        assert stream.lost >= SLOTS
        owner.add(7)
        assert await stream.next(PATIENCE_S) == Int(7)
        assert stream.resyncs == 2


async def test_snapshot_is_taken_when_owner_comes(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as reader:
        stream = reader.snapshot_stream("map/delta", Int, Text)
        with pytest.raises(NoAnswer, match=r"no snapshot within 0\.1 s"):
            await stream.next(0.1)
        waiting = asyncio.create_task(anext(stream))
        async with Module("mapper", node=node) as owner:
            Sum(owner).add(5)
            assert isinstance(await waiting, Text)
        stream.close()
