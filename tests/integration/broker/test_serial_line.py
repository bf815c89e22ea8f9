"""Two brokers with nothing but a serial line between them."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.integration.broker.lines import Line
from tests.integration.broker.swarm import Recorder, Station, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmware.model.frame import FrameKind
from swarmware.types.net import NeighbourState
from swarmware.types.scalar import Text
from swarmware.types.vehicle import Pose

BAUD = 57_600


@asynccontextmanager
async def pair(
    tmp_path: Path, baud: int = BAUD, **common: Any
) -> AsyncIterator[tuple[Line, Station, Station]]:
    """uav1 and uav2 on a line that is not yet known to be up."""
    line = Line(tmp_path)
    try:
        settings = {
            name: {"serial": [{"name": "modem", "device": str(device), "baud": baud}]}
            for name, device in zip(("uav1", "uav2"), line.devices, strict=True)
        }
        async with swarm(tmp_path, "uav1", "uav2", multicast_group="", settings=settings, **common) as found:
            yield line, found["uav1"], found["uav2"]
    finally:
        line.close()


async def until_both_are_up(one: Station, other: Station) -> None:
    await one.until_up("uav2")
    await other.until_up("uav1")


def neighbour(station: Station) -> NeighbourState:
    """What it says of the only neighbour."""
    table = station.neighbours.value
    assert table is not None
    (found,) = table.neighbours
    return found


@on_uvloop
async def test_boards_commands_and_answers_pass_over_serial_line(tmp_path: Path) -> None:
    async with pair(tmp_path) as (_, one, other):
        await until_both_are_up(one, other)
        called: list[str] = []
        other.app.serve("cmd/echo", Text, Recorder("cmd/echo", called), reply=Text)
        inbox = other.app.inbox("cmd/order", Text)
        assert await one.app.send("/uav2/cmd/order", Text("go"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "go"
        answer = await one.app.request("/uav2/cmd/echo", Text("there?"), Text, timeout_s=PATIENCE_S)
        assert answer == Text("there?")
        shown = neighbour(one)
        assert shown.transport == "udp"
        assert [medium.medium for medium in shown.media] == ["modem"]
        traffic = await one.traffic()
        assert traffic.tcp_sent_bytes == 0
        sent = {link.transport for link in traffic.links if link.platform == "uav2" and link.sent_bytes}
        assert sent == {"serial"}


@on_uvloop
async def test_value_larger_than_datagram_passes_serial_line(tmp_path: Path) -> None:
    async with pair(tmp_path, 921_600) as (_, one, other):
        await until_both_are_up(one, other)
        inbox = other.app.inbox("map/delta", Text)
        text = Text("x" * 20_000)
        assert await one.app.send("/uav2/map/delta", text, kind=FrameKind.STREAM, timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == text.value


@on_uvloop
async def test_boards_pass_and_serial_line_is_never_overrun(tmp_path: Path) -> None:
    baud = 9600
    async with pair(tmp_path, baud) as (line, one, other):
        pose = one.app.writer("nav/pose", Pose)
        mirror = other.app.reader("/uav1/nav/pose", Pose)
        one.plan(offers=[("nav/pose", Pose)])
        other.plan(wants=[("uav1", "nav/pose", Pose)])
        await until_both_are_up(one, other)
        pose.write(Pose.planar(1.0, 2.0))
        assert (await mirror.changed(PATIENCE_S)).x_m == 1.0
        line.bytes.clear()
        sends = [one.app.send("/uav2/cmd/order", Text("x" * 200), timeout_s=PATIENCE_S) for _ in range(10)]
        inbox = other.app.inbox("cmd/order", Text)
        outcomes = await asyncio.gather(*sends)
        assert all(outcomes)
        assert [len((await anext(inbox)).value) for _ in sends] == [200] * 10
        first_s, last_s = line.bytes[0][0], line.bytes[-1][0]
        written = sum(count for _, count in line.bytes[:-1])
        assert written >= 10 * 200
        assert written <= (last_s - first_s) * baud / 10 + 1300, "one frame is ahead of the line"


@on_uvloop
async def test_bytes_without_frame_are_refused_counted_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with pair(tmp_path) as (line, one, other):
        await until_both_are_up(one, other)
        line.disturb(b"AT+RESET\r\n\0" + bytes(range(1, 200)) + b"\0\x02\x07\0")
        await other.until_counted(lambda traffic: traffic.refused.damaged >= 3)
        assert "medium modem: a frame on " in caplog.text
        assert "CRC wrong" in caplog.text
        assert "COBS: a block is cut short" in caplog.text
        assert (await other.traffic()).refused.forged == 0
        inbox = other.app.inbox("cmd/order", Text)
        assert await one.app.send("/uav2/cmd/order", Text("go"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "go"


@on_uvloop
async def test_a_line_that_was_unplugged_is_opened_again(tmp_path: Path) -> None:
    async with pair(tmp_path) as (line, one, other):
        await until_both_are_up(one, other)
        line.unplug()
        await one.until(lambda: one.states() == {"uav2": "down"}, one.neighbours)
        await one.until(lambda: one.conditions().get("broker/medium_modem") == "closed", one.checks)
        line.plug()
        await until_both_are_up(one, other)
        await one.until(lambda: one.conditions().get("broker/medium_modem") == "ok", one.checks)


@on_uvloop
async def test_restarted_node_returns_over_serial_line_alone(tmp_path: Path) -> None:
    async with pair(tmp_path) as (_, one, other):
        await until_both_are_up(one, other)
        await other.stop()
        await one.until(lambda: one.states() == {"uav2": "down"}, one.neighbours)
        await other.start()
        await until_both_are_up(one, other)
        inbox = other.app.inbox("cmd/order", Text)
        assert await one.app.send("/uav2/cmd/order", Text("go"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "go"


@on_uvloop
async def test_direction_that_is_dead_makes_link_half_open(tmp_path: Path) -> None:
    async with pair(tmp_path) as (line, one, other):
        await until_both_are_up(one, other)
        line.is_cut = True
        await other.until(lambda: other.states() == {"uav1": "down"}, other.neighbours)
        await one.until(lambda: one.states() == {"uav2": "half_open"}, one.neighbours)
        await one.until(lambda: neighbour(one).media[0].state == "half_open", one.neighbours)
        line.is_cut = False
        await until_both_are_up(one, other)
