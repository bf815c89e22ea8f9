"""Two nodes over a loopback that drops packets; prints what became of their messages and items.

Run by test_lossy_links.py as `unshare --net python lossylink.py LOSS_PERCENT`.
"""

import asyncio
import json
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Final

import uvloop
from tests.integration.broker.swarm import Station, swarm
from tests.patience import PATIENCE_S

from swarmware.model.frame import FrameKind
from swarmware.module.inbox import Inbox
from swarmware.types.scalar import Text

MESSAGES: Final = 100
MESSAGE_S: Final = 0.1
ITEMS: Final = 300
ITEM_S: Final = 1 / 30
ITEM: Final = "x" * 1000


def drop(percent: int) -> None:
    """Drops this share of all packets that arrive, in both directions."""
    rules = f"""
        table inet radio {{
            chain input {{
                type filter hook input priority 0;
                numgen random mod 100 < {percent} drop
            }}
        }}
    """
    subprocess.run(["nft", "-f", "-"], input=rules, text=True, check=True)


async def send_all(
    station: Station, path: str, count: int, period_s: float, kind: FrameKind, text: str
) -> list[float]:
    """Time until each of the messages was acknowledged; infinite if its sender got another outcome."""
    loop = asyncio.get_running_loop()
    times_s: list[float] = []

    async def one(number: int) -> None:
        start_s = loop.time()
        outcome = await station.app.send(path, Text(f"{number} {text}"), kind=kind, timeout_s=PATIENCE_S)
        times_s.append(loop.time() - start_s if outcome else float("inf"))

    first_s = loop.time()
    async with asyncio.TaskGroup() as group:
        for number in range(count):
            group.create_task(one(number), name=f"{path} {number}")
            await asyncio.sleep(max(0.0, first_s + (number + 1) * period_s - loop.time()))
    return sorted(times_s)


def is_by_datagram(station: Station) -> bool:
    """Whether its frames to the other one travel in datagrams."""
    table = station.neighbours.value
    return table is not None and table.neighbours[0].transport == "udp"


async def drain(inbox: Inbox[Text], texts: list[str]) -> None:
    """Takes everything that arrives."""
    while True:
        texts.append((await anext(inbox)).value)


async def measure(root: Path, percent: int) -> dict[str, float]:
    async with swarm(root, "uav1", "uav2") as pair:
        await pair["uav1"].until_up("uav2")
        await pair["uav2"].until_up("uav1")
        receiver = pair["uav2"]
        taken: dict[str, list[str]] = {"cmd/order": [], "map/delta": []}
        for path, texts in taken.items():
            receiver.app.start(drain(receiver.app.inbox(path, Text), texts), f"reader of {path}")
        app = pair["uav1"].app
        assert await app.send("/uav2/cmd/order", Text("a connection is made"), timeout_s=30)
        drop(percent)

        for station in (pair["uav1"], pair["uav2"]):
            await station.until(partial(is_by_datagram, station), station.neighbours)
        orders, deltas = await asyncio.gather(
            send_all(pair["uav1"], "/uav2/cmd/order", MESSAGES, MESSAGE_S, FrameKind.MESSAGE, ""),
            send_all(pair["uav1"], "/uav2/map/delta", ITEMS, ITEM_S, FrameKind.STREAM, ITEM),
        )
        traffic = await pair["uav1"].traffic()
        return {
            "delivered": sum(one < 10 for one in orders),
            "told": MESSAGES,
            "p50_s": orders[len(orders) // 2],
            "offered": ITEMS,
            "items": len(set(taken["map/delta"])),
            "twice": sum(len(texts) - len(set(texts)) for texts in taken.values()),
            "items_acknowledged": sum(one < 10 for one in deltas),
            "item_p50_s": deltas[len(deltas) // 2],
            "udp_bytes": traffic.udp_sent_bytes,
            "tcp_bytes": traffic.tcp_sent_bytes,
            "repeated_bytes": sum(link.repeated_bytes for link in traffic.links),
        }


if __name__ == "__main__":
    subprocess.run(["ip", "link", "set", "lo", "mtu", "1500", "up"], check=True)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as folder,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        print(json.dumps(runner.run(measure(Path(folder), int(sys.argv[1])))))
