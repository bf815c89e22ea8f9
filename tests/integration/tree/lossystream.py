"""A stream between two nodes over a loopback that drops packets or is slow; prints what its reader got.

Run by test_lossy_streams.py as `unshare --net python lossystream.py RATE_HZ SECONDS [--loss PERCENT]
[--link RATE] [--recording FILE]`. Items have 1 000 bytes; items of a recording are the packets of a
scanner (1 206 bytes).
"""

import argparse
import asyncio
import itertools
import json
import subprocess
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec
import uvloop
from tests.integration.files.lossyfile import drop
from tests.integration.tree.pair import Platform, platforms, until
from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer
from swarmware.module.stream import StreamReader
from swarmware.module.streamwriter import StreamWriter
from swarmware.types.net import ConnectionStatus, Neighbours
from swarmware.types.registry import register

SERVICES: Final = (("broker", "tree"),)
PATH: Final = "lidar/packets"
ITEM_BYTES: Final = 1000
PACKET_BYTES: Final = 1206
SETTLE_S: Final = 60.0
"""Time after the last item within which the others arrive, or are reported as lost.

A link of 1 Mbit/s needs 25 s for a full queue.
"""
CLOSE_S: Final = 2.0
"""The tree publishes losses once a second."""


@register
class ScanPacket(msgspec.Struct, frozen=True, array_like=True):
    """An item of the stream."""

    number: int
    data: bytes


class Taken:
    """What the reader has got."""

    def __init__(self, reader: StreamReader[ScanPacket], now_ns: Callable[[], int]) -> None:
        self.reader = reader
        self.numbers: list[int] = []
        self.late_ms: list[float] = []
        self._now_ns = now_ns
        self._news = asyncio.Event()

    async def more(self) -> None:
        """Returns when another item has arrived."""
        self._news.clear()
        await self._news.wait()

    async def run(self) -> None:
        async for packet in self.reader:
            self.numbers.append(packet.number)
            self._news.set()
            if self.reader.meta is not None:
                self.late_ms.append((self._now_ns() - self.reader.meta.stamp_ns) / 1e6)


def is_lossy(table: Neighbours) -> bool:
    """Whether frames to the other node travel in datagrams."""
    return bool(table.neighbours) and table.neighbours[0].transport is ConnectionStatus.DATAGRAMS


async def first_item(writer: StreamWriter[ScanPacket], taken: Taken) -> None:
    """Writes until the reader has one: its subscription is in force."""
    async with asyncio.timeout(PATIENCE_S):
        while not taken.numbers:
            writer.write(ScanPacket(-1, b""))
            await asyncio.sleep(0.1)
    await asyncio.sleep(1.0)
    taken.numbers.clear()
    taken.late_ms.clear()


async def measure(
    root: Path, percent: int, rate_hz: float, seconds: float, packets: list[bytes]
) -> dict[str, float]:
    async with platforms(root, "gcs", "uav1", services=SERVICES) as (gcs, uav1):
        writer = uav1.probe.stream_writer(PATH, ScanPacket)
        reader = gcs.probe.stream_reader(f"/uav1/{PATH}", ScanPacket)
        taken = Taken(reader, gcs.probe.now_ns)
        gcs.probe.start(taken.run(), "reader")
        await first_item(writer, taken)
        if percent:
            drop(percent)
            await until_lossy(uav1)
        lost_before = reader.lost
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        count = round(seconds * rate_hz)
        for number, data in zip(range(count), itertools.cycle(packets)):
            writer.write(ScanPacket(number, data))
            await asyncio.sleep(max(0.0, began_s + (number + 1) / rate_hz - loop.time()))
        took_s = loop.time() - began_s
        in_time = len(taken.numbers)
        with suppress(NoAnswer, TimeoutError):
            async with asyncio.timeout(SETTLE_S):
                while len(taken.numbers) + reader.lost - lost_before < count:
                    await taken.more()
        await asyncio.sleep(CLOSE_S)
        late = sorted(taken.late_ms)
        return {
            "written": count,
            "received": len(taken.numbers),
            "in_order": float(taken.numbers == sorted(set(taken.numbers))),
            "received_s": in_time / took_s,
            "written_s": count / took_s,
            "reader_lost": reader.lost - lost_before,
            "writer_lost": writer.lost,
            "p50_ms": late[len(late) // 2],
            "p99_ms": late[int(0.99 * len(late))],
        }


async def until_lossy(node: Platform) -> None:
    """Returns when the loss of the link is known."""
    await until(node.probe.reader("net/neighbours", Neighbours), is_lossy)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("rate_hz", type=float)
    parser.add_argument("seconds", type=float)
    parser.add_argument("--loss", type=int, default=0)
    parser.add_argument("--link", default="")
    parser.add_argument("--recording", type=Path)
    args = parser.parse_args()
    packets = [bytes(ITEM_BYTES)]
    if args.recording is not None:
        data = args.recording.read_bytes()
        packets = [data[at : at + PACKET_BYTES] for at in range(0, len(data), PACKET_BYTES)]
    subprocess.run(["ip", "link", "set", "lo", "mtu", "1500", "up"], check=True)
    if args.link:
        slow = f"tbf rate {args.link} burst 4kb limit 32kb"
        subprocess.run(["tc", "qdisc", "add", "dev", "lo", "root", *slow.split()], check=True)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as place,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        print(json.dumps(runner.run(measure(Path(place), args.loss, args.rate_hz, args.seconds, packets))))


if __name__ == "__main__":
    main()
