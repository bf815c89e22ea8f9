"""Values of many megabytes between nodes: whole, refused above the limit, and no delay for commands."""

import asyncio
import statistics
from pathlib import Path

import pytest
from tests.integration.broker.swarm import on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmware.errors import OutOfRange
from swarmware.transport.delivery.parts import VALUE_LIMIT
from swarmware.types.scalar import Text

OVERHEAD = 6
"""Bytes of a long text around it."""


@on_uvloop
async def test_value_beyond_64_mib_is_refused(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        await pair["uav1"].until_up("uav2")
        await pair["uav2"].until_up("uav1")
        tiles = pair["uav2"].app.inbox("map/tile", Text)
        pair["uav2"].app.serve("map/render", Text, lambda request, _: request, reply=Text)
        orders = pair["uav2"].app.inbox("cmd/order", Text)
        app = pair["uav1"].app
        text = "x" * (VALUE_LIMIT - OVERHEAD)
        with pytest.raises(OutOfRange, match=f"{VALUE_LIMIT + 1} bytes: expected at most {VALUE_LIMIT}"):
            await app.send("/uav2/map/tile", Text(text + "x"))
        assert await app.send("/uav2/cmd/order", Text("first"), timeout_s=PATIENCE_S)
        loop = asyncio.get_running_loop()
        sending = asyncio.create_task(app.send("/uav2/map/tile", Text(text), timeout_s=100))
        times: list[float] = []
        while not sending.done():
            began_s = loop.time()
            assert await app.send("/uav2/cmd/order", Text("go"), timeout_s=PATIENCE_S)
            times.append(loop.time() - began_s)
            orders.take()
            await asyncio.sleep(0.02)
        outcome = await sending
        assert outcome, outcome
        assert outcome.where == "uav2:app#1"
        assert tiles.take() == Text(text)
        part = Text(text[: 9 << 20])
        assert await app.request("/uav2/map/render", part, Text, timeout_s=60) == part
        assert statistics.median(times) < 0.2, "commands do not wait for a large value"
