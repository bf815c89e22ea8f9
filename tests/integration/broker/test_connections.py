"""Commands and data have a connection each to a neighbour."""

import asyncio
from pathlib import Path
from typing import Final

import pytest
from tests.integration.broker.namespace import figures_of
from tests.integration.broker.swarm import on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmware.model.frame import FrameKind
from swarmware.types.net import Neighbours
from swarmware.types.rpc import Empty
from swarmware.types.scalar import Text

_ESTABLISHED: Final = "01"


def connections(port: int) -> int:
    """TCP connections that were accepted on a local port."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return sum(row[1].endswith(f":{port:04X}") and row[3] == _ESTABLISHED for row in rows)


@on_uvloop
async def test_data_has_own_connection_from_first_frame(tmp_path: Path) -> None:
    port = free_port()
    # a command over a link that was measured meanwhile would be a datagram
    settings: dict[str, dict[str, object]] = {"uav1": {"frames": "tcp"}, "uav2": {"tcp_port": port}}
    async with swarm(tmp_path, "uav1", "uav2", settings=settings) as pair:
        await pair["uav1"].until_up("uav2")
        await pair["uav2"].until_up("uav1")
        pair["uav1"].app.inbox("plan/share", Text)  # its path is known here, so it is counted by it
        await asyncio.sleep(0)  # the application's file is written in the next turn
        pair["uav1"].node.table.refresh()
        box = pair["uav2"].app.inbox("plan/share", Text)
        send = pair["uav1"].app.send
        assert await send("/uav2/plan/share", Text("command"), timeout_s=PATIENCE_S)
        assert connections(port) == 1
        for number in range(3):
            assert await send(
                "/uav2/plan/share", Text(str(number)), kind=FrameKind.NOTIFY, timeout_s=PATIENCE_S
            )
        assert connections(port) == 2
        assert await send("/uav2/plan/share", Text("file"), kind=FrameKind.FILE, timeout_s=PATIENCE_S)
        assert connections(port) == 2
        assert len(box) == 5
        links = await pair["uav1"].app.request("sys/broker/links", Empty(), Neighbours, timeout_s=PATIENCE_S)
        assert [one.transport for one in links.neighbours] == ["tcp"]
        [counted] = [one for one in (await pair["uav1"].traffic()).channels if one.channel == "plan/share"]
        assert counted.sent_frames >= 5
        await pair["uav2"].stop()
        await pair["uav1"].until(lambda: pair["uav1"].states()["uav2"] != "up", pair["uav1"].neighbours)
        links = await pair["uav1"].app.request("sys/broker/links", Empty(), Neighbours, timeout_s=PATIENCE_S)
        assert [one.transport for one in links.neighbours] == ["idle"]


@pytest.mark.root
def test_abort_overtakes_notifications_of_32_kb() -> None:
    seen = figures_of("slowlink.py", tools=("ip", "tc"))
    assert seen["backlog_s"] > 10, "the notifications were through too soon to prove anything"
    # less than what one connection takes out of our queue needs; what the kernel holds comes on top there
    assert seen["loaded_s"] < seen["taken_s"], seen
