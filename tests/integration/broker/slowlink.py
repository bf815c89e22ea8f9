"""Two nodes over a loopback of 2 Mbit/s; prints how long an abort takes among notifications.

Run by test_connections.py as `unshare --net python slowlink.py`.
"""

import asyncio
import json
import statistics
import subprocess
import tempfile
from pathlib import Path
from typing import Final

import uvloop
from tests.integration.broker.swarm import Station, swarm

from swarmd.broker.exchange.carriers.zmq_links import SEND_HIGH_WATER
from swarmd.tree.core.action import SendNotify
from swarmd.tree.core.notification.lane import LaneNumber
from swarmware.model.frame import FrameKind
from swarmware.types.scalar import Text
from swarmware.types.tree_exchange import TreeItem, TreeNotify

RATE_BYTES_S: Final = 250_000
NOTE_BYTES: Final = 32_000
NOTES: Final = 200
"""Unanswered notifications to one platform, fewer than the message router allows."""
ABORTS: Final = 5


async def abort_s(station: Station) -> float:
    """Median time from an abort to its acknowledgement."""
    loop = asyncio.get_running_loop()
    times: list[float] = []
    for _ in range(ABORTS):
        start_s = loop.time()
        assert await station.app.send("/uav2/cmd/abort", Text("now"), urgent=True, timeout_s=30)
        times.append(loop.time() - start_s)
    return statistics.median(times)


async def measure(root: Path) -> dict[str, float]:
    async with swarm(root, "uav1", "uav2") as pair:
        await pair["uav1"].until_up("uav2")
        await pair["uav2"].until_up("uav1")
        pair["uav2"].app.inbox("cmd/abort", Text)
        notes = pair["uav2"].app.inbox("sys/tree/notify", TreeNotify)
        app = pair["uav1"].app
        await abort_s(pair["uav1"])  # makes the connections
        for number in range(NOTES):
            item = TreeItem("x/scan", 1, FrameKind.BOARD, number, 0, bytes(NOTE_BYTES))
            action = SendNotify("uav2", TreeNotify("uav1", 1, 1, (item,), lane=LaneNumber.BOARDS))
            path = f"/{action.platform}/sys/tree/notify"
            app.start(app.send(path, action.notify, kind=action.kind, timeout_s=60), f"note {number}")
        await asyncio.wait_for(anext(notes), 30)
        backlog_s = (NOTES - 1 - len(notes)) * NOTE_BYTES / RATE_BYTES_S
        return {
            "loaded_s": await abort_s(pair["uav1"]),
            "backlog_s": backlog_s,
            "taken_s": SEND_HIGH_WATER * NOTE_BYTES / RATE_BYTES_S,
        }


if __name__ == "__main__":
    slow = f"tbf rate {RATE_BYTES_S * 8} burst 16kb limit 500kb"
    subprocess.run(["ip", "link", "set", "lo", "mtu", "1500", "up"], check=True)
    subprocess.run(["tc", "qdisc", "add", "dev", "lo", "root", *slow.split()], check=True)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as folder,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        print(json.dumps(runner.run(measure(Path(folder)))))
