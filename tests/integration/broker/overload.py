"""Two nodes over a loopback of 1 Mbit/s; prints how late beacons and commands are under ten times its rate.

Run by test_overload.py as `unshare --net python overload.py SECONDS`. Offered are the packets of a scanner
(753 a second of 1 206 bytes, as streams of a tree in lots of 20 ms), notifications of boards, and files.
"""

import asyncio
import json
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Final

import uvloop
from tests.integration.broker.swarm import Station, swarm
from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer
from swarmware.model.frame import FrameKind
from swarmware.module.board import BoardReader
from swarmware.types.net import ConnectionStatus, LinkTransport
from swarmware.types.scalar import Text

RATE_BIT_S: Final = 1_000_000
OFFERS: Final = (
    ("map/scan", FrameKind.STREAM, 18_090, 50.0),
    ("map/notes", FrameKind.NOTIFY, 2_000, 100.0),
    ("map/tile", FrameKind.FILE, 16_384, 10.0),
)
"""Path, kind, bytes and rate: 7.2, 1.6 and 1.3 Mbit/s."""
SETTLE_S: Final = 6.0
"""Until the queue of the link was seen, and what TCP had taken has left."""
COMMAND_S: Final = 0.2
BOARD_S: Final = 0.1


async def offer(station: Station, path: str, kind: FrameKind, size: int, rate_hz: float) -> None:
    """Sends for ever, whether it arrives or not."""
    text = Text("x" * size)
    async with asyncio.TaskGroup() as group:
        while True:
            group.create_task(station.app.send(f"/uav2/{path}", text, kind=kind, timeout_s=2.0))
            await asyncio.sleep(1 / rate_hz)


async def write(station: Station) -> None:
    """The state of the vehicle, in each beacon."""
    writer = station.app.writer("nav/note", Text)
    number = 0
    while True:
        number += 1
        writer.write(Text(str(number)))
        await asyncio.sleep(BOARD_S)


async def ages_ms(board: BoardReader[Text], clock_ns: Station, into: list[float]) -> None:
    """Age of each value at its arrival; the nodes have the same clock."""
    while True:
        await board.changed()
        if board.meta is not None:
            into.append((clock_ns.app.now_ns() - board.meta.stamp_ns) / 1e6)


async def commands_ms(station: Station, seconds: float) -> list[float]:
    """Time until each command was acknowledged; infinite if its sender got another outcome."""
    loop = asyncio.get_running_loop()
    times: list[float] = []

    async def one() -> None:
        start_s = loop.time()
        outcome = await station.app.send("/uav2/cmd/order", Text("go"), timeout_s=PATIENCE_S)
        times.append(1000 * (loop.time() - start_s) if outcome else float("inf"))

    ends_s = loop.time() + seconds
    async with asyncio.TaskGroup() as group:
        while loop.time() < ends_s:
            group.create_task(one())
            await asyncio.sleep(COMMAND_S)
    return times


def share(values: list[float], ratio: float) -> float:
    """The value that this share of them does not exceed."""
    return sorted(values)[min(int(ratio * len(values)), len(values) - 1)]


async def measure(root: Path, seconds: float) -> dict[str, float]:
    async with swarm(root, "uav1", "uav2") as pair:
        one, two = pair["uav1"], pair["uav2"]
        one.plan(offers=[("nav/note", Text)])
        two.plan(wants=[("uav1", "nav/note", Text)])
        await one.until_up("uav2")
        await two.until_up("uav1")
        await until_measured(one)
        await until_measured(two)
        for path in ("cmd/order", *(path for path, *_ in OFFERS)):
            inbox = two.app.inbox(path, Text)
            two.app.start(drain(inbox), path)
        board = two.app.reader("/uav1/nav/note", Text)
        one.app.start(write(one), "boards")
        await commands_ms(one, 1.0)
        for path, kind, size, rate_hz in OFFERS:
            one.app.start(offer(one, path, kind, size, rate_hz), path)
        await asyncio.sleep(SETTLE_S)
        ages: list[float] = []
        two.app.start(ages_ms(board, two, ages), "ages")
        before = await one.traffic()
        commands = await commands_ms(one, seconds)
        after = await one.traffic()
        table = one.neighbours.value
        assert table is not None
        dropped = {link.transport: link.dropped for link in after.links}
        return {
            "dropped": dropped[LinkTransport.UDP],
            "commands": len(commands),
            "command_p50_ms": share(commands, 0.5),
            "command_p99_ms": share(commands, 0.99),
            "beacons": len(ages),
            "beacon_p50_ms": share(ages, 0.5),
            "beacon_p99_ms": share(ages, 0.99),
            "by_datagram": table.neighbours[0].transport is ConnectionStatus.DATAGRAMS,
            "sent_bit_s": 8 * (after.udp_sent_bytes - before.udp_sent_bytes) / seconds,
            "offered_bit_s": 8 * sum(size * rate_hz for _, _, size, rate_hz in OFFERS),
        }


async def until_measured(station: Station) -> None:
    """Waits for the round trip without a queue: the one with a queue is compared with it."""
    while (table := station.neighbours.value) is None or table.neighbours[0].rtt_ms is None:
        await station.neighbours.changed(timeout_s=PATIENCE_S)


async def drain(inbox: object) -> None:
    """Takes everything that arrives."""
    with suppress(NoAnswer):
        async for _ in inbox:  # type: ignore[attr-defined]  # an inbox of any type
            pass


if __name__ == "__main__":
    slow = f"tbf rate {RATE_BIT_S} burst 4kb limit 32kb"
    subprocess.run(["ip", "link", "set", "lo", "mtu", "1500", "up"], check=True)
    subprocess.run(["tc", "qdisc", "add", "dev", "lo", "root", *slow.split()], check=True)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as folder,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        print(json.dumps(runner.run(measure(Path(folder), float(sys.argv[1])))))
