"""Stamps of other hardware units on the own clock, as timesync publishes the functions."""

import logging
from pathlib import Path

import pytest

from swarmware.model.names import hardware_id
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.scalar import Text
from swarmware.types.time import Conversion, TimeFunctions

UAV7, UAV8 = hardware_id("uav7"), hardware_id("uav8")


def ahead(name: str, by_ns: int, rate: float = 0.0) -> Conversion:
    """The clock of a unit that is ahead of ours by so much, and gains `rate` per second from instant 0 on."""
    return Conversion(name, "main", hardware_id(name), 1, by_ns, rate, 0, 0, 0, 0.0, 1)


def functions(found: tuple[Conversion, ...]) -> TimeFunctions:
    return TimeFunctions("uav1", "main", 1, 0, found)


async def test_clocks_are_unknown_until_timesync_has_published(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        clocks = m.remote_clocks
        assert clocks.to_local(node.hardware, 5) == 5, "our own needs no function"
        assert (clocks.conversion(UAV7), clocks.to_local(UAV7, 5)) == (None, None)
        m.writer("time/functions", TimeFunctions).write(functions((ahead("uav7", 1000),)))
        assert clocks.to_local(UAV7, 5_000) == 4_000
        assert clocks.to_local(UAV8, 5_000) is None


async def test_newest_functions_count_and_departed_is_unknown(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        writer, clocks = m.writer("time/functions", TimeFunctions), m.remote_clocks
        for number in range(3):
            writer.write(functions((ahead("uav7", number * 1000),)))
            assert clocks.to_local(UAV7, 10_000) == 10_000 - number * 1000
        writer.write(functions((ahead("uav8", 500),)))
        assert (clocks.to_local(UAV7, 10_000), clocks.to_local(UAV8, 10_000)) == (None, 9_500)


async def test_invalid_function_table_leaves_clocks_unchanged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        clocks = m.remote_clocks
        writer = m.writer("time/functions", TimeFunctions)
        writer.write(functions((ahead("uav7", 1000),)))
        assert clocks.to_local(UAV7, 5_000) == 4_000
        with caplog.at_level(logging.DEBUG), writer.loan(4) as slot:
            slot[:] = b"\xc1\xc1\xc1\xc1"
        assert clocks.to_local(UAV7, 5_000) == 4_000
        m.close_writer(writer)
        m.writer("time/functions", Text).write(Text("now"))
        assert clocks.to_local(UAV7, 5_000) == 4_000


async def test_clocks_that_were_closed_may_be_asked_again(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        m.writer("time/functions", TimeFunctions).write(functions((ahead("uav7", 1000),)))
        for _ in range(2):
            assert m.remote_clocks.to_local(UAV7, 5_000) == 4_000
            m.remote_clocks.close()
