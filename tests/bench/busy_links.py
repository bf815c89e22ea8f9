"""A stream and messages at once over a link that loses 40 %, while other programs use both cores.

    python tests/bench/busy_links.py [--loops N] [--seconds S] [--lab NAME] [--json]

Four nodes in namespaces (`swarmctl lab up --net netns --radio lan`), all their daemons running; every link
loses 40 % of the frames in both directions. One node has a stream of 30 items of 1 kB a second for another
one, and sends it five messages of 200 B a second. Measured without other programs, then beside `--loops`
processes that count without a pause, at the priority of the nodes. An age is above the least one of the run,
because clocks of a lab differ. Needs the rights of `--net netns`.
"""

import asyncio
import itertools
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

from lab import options, radio_lab
from radio_links import INBOX, MESSAGE_BYTES, MESSAGE_S, NODES, PATIENCE_S, drain
from rows import Row, print_rows

from swarmctl.session.labs import LabState
from swarmlab.radio.core.link import ImpairmentChange
from swarmlab.radio.orders import ImpairLinks, send
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.types.net import ConnectionStatus, Neighbours
from swarmware.types.scalar import Blob

OWN: Final = "bench-busy"
LOSS: Final = 0.4
ITEM_HZ: Final = 30.0
ITEM_BYTES: Final = 1000
LEAST_HZ: Final = 29.0
TIMEOUT_S: Final = 2.0
SETTLE_S: Final = 20.0
"""Time after the last item within which the others arrive, or are reported as lost."""
STREAM: Final = "bench/items"
NUMBER: Final = 4
"""Bytes of the number of an item."""
LOOP: Final = "while True: pass"


@contextmanager
def busy(loops: int) -> Iterator[None]:
    """Context manager: other programs that use the processor."""
    running = [subprocess.Popen([sys.executable, "-c", LOOP]) for _ in range(loops)]
    try:
        yield
    finally:
        for one in running:
            one.kill()
            one.wait()


class Taken:
    """Items of the stream that have arrived."""

    def __init__(self, reader: StreamReader[Blob], module: Module) -> None:
        self.reader = reader
        self.numbers: list[int] = []
        self.ages_s: list[float] = []
        self._module = module
        self._news = asyncio.Event()

    async def run(self) -> None:
        """Takes everything that arrives."""
        async for item in self.reader:
            self.numbers.append(int.from_bytes(item.value[:NUMBER], "little"))
            if self.reader.meta is not None:
                self.ages_s.append((self._module.now_ns() - self.reader.meta.stamp_ns) / 1e9)
            self._news.set()

    async def more(self) -> None:
        """Returns when another item has arrived."""
        self._news.clear()
        await self._news.wait()


class Bench:
    """An application on each of two nodes: one sends, the other one receives."""

    def __init__(self, sender: Module, receiver: Module, own: str, name: str) -> None:
        """`own`, `name`: platforms of the sender and the receiver."""
        self._sender = sender
        self._target = f"/{name}/{INBOX}"
        self._writer = sender.stream_writer(STREAM, Blob)
        self._taken = Taken(receiver.stream_reader(f"/{own}/{STREAM}", Blob), receiver)
        receiver.start(drain(receiver.inbox(INBOX, Blob)), "drain")
        receiver.start(self._taken.run(), "reader")

    async def until_subscribed(self) -> None:
        """Waits until the reader has an item and a message arrives."""
        async with asyncio.timeout(PATIENCE_S):
            while not self._taken.numbers:
                self._write(0)
                await asyncio.sleep(0.1)
            while not await self._sender.send(self._target, Blob(b""), timeout_s=1.0):
                pass

    def _write(self, number: int) -> None:
        self._writer.write(Blob(number.to_bytes(NUMBER, "little") + bytes(ITEM_BYTES - NUMBER)))

    async def _message(self) -> tuple[str, float]:
        loop = asyncio.get_running_loop()
        start_s = loop.time()
        outcome = await self._sender.send(self._target, Blob(bytes(MESSAGE_BYTES)), timeout_s=TIMEOUT_S)
        return outcome.status.name.lower(), loop.time() - start_s

    async def measure(self, seconds: float, what: str) -> list[Row]:
        """Stream and messages together."""
        await asyncio.sleep(1.0)
        taken, loop = self._taken, asyncio.get_running_loop()
        taken.numbers.clear()
        taken.ages_s.clear()
        lost_before = taken.reader.lost
        began_s, count = loop.time(), round(seconds * ITEM_HZ)
        messages: list[asyncio.Task[tuple[str, float]]] = []
        for number in range(count):
            self._write(number)
            if number % round(MESSAGE_S * ITEM_HZ) == 0:
                messages.append(asyncio.create_task(self._message(), name=f"message {number}"))
            await asyncio.sleep(max(0.0, began_s + (number + 1) / ITEM_HZ - loop.time()))
        rate_hz = len(taken.numbers) / (loop.time() - began_s)
        outcomes = await asyncio.gather(*messages)
        with suppress(TimeoutError):
            async with asyncio.timeout(SETTLE_S):
                while len(taken.numbers) + taken.reader.lost - lost_before < count:
                    await taken.more()
        return [*_rows(what, count, rate_hz, taken, outcomes)]


def _rows(
    what: str, count: int, rate_hz: float, taken: Taken, outcomes: list[tuple[str, float]]
) -> Iterator[Row]:
    in_order = taken.numbers == sorted(set(taken.numbers))
    yield Row(
        f"stream 30 x 1 kB/s beside messages, 40 % loss, {what}",
        f"{len(taken.numbers)} of {count}{' in order' if in_order else ''}, {rate_hz:.1f} /s,"
        f" p99 {_p99([age - min(taken.ages_s) for age in taken.ages_s]) * 1000:.0f} ms",
        f"100 % in order, ≥ {LEAST_HZ:g} /s",
        in_order and len(taken.numbers) == count and rate_hz >= LEAST_HZ,
    )
    counts = Counter(status for status, _ in outcomes)
    yield Row(
        f"messages beside that stream, 40 % loss, {what}",
        f"{', '.join(f'{n} {status}' for status, n in counts.most_common())} of {len(outcomes)},"
        f" p99 {_p99([took for _, took in outcomes]) * 1000:.0f} ms",
        "none expired",
        counts["delivered"] == len(outcomes),
    )


def _p99(values: list[float]) -> float:
    ordered = sorted(values)
    return ordered[int(0.99 * (len(ordered) - 1))] if ordered else float("inf")


async def until_lossy(module: Module, platform: str) -> None:
    """Waits until frames to a node travel in datagrams."""
    reader = module.reader("net/neighbours", Neighbours)
    async with asyncio.timeout(PATIENCE_S):
        while not any(
            one.platform == platform and one.transport is ConnectionStatus.DATAGRAMS
            for one in (reader.value or Neighbours()).neighbours
        ):
            await reader.changed()


async def measure(lab: LabState, loops: int, seconds: float) -> list[Row]:
    """All rows: without other programs, and beside them."""
    async with AsyncExitStack() as stack:
        here, there = [
            await stack.enter_async_context(Module("bench", config_dir=node.config_dir))
            for node in lab.nodes[:2]
        ]
        names = [node.platform for node in lab.nodes]
        bench = Bench(here, there, names[0], names[1])
        await bench.until_subscribed()
        links = tuple(itertools.permutations(names, 2))
        send(Path(lab.folder), ImpairLinks(links, ImpairmentChange(loss_ratio=LOSS)))
        await until_lossy(here, names[1])
        await until_lossy(there, names[0])
        rows = await bench.measure(seconds, "no other program")
        with busy(loops):
            return rows + await bench.measure(seconds, f"beside {loops} busy loops")


def main() -> None:
    """Measures and prints."""
    parser = options(__doc__)
    parser.add_argument("--loops", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    with radio_lab(given.lab, OWN, NODES, "lan") as lab:
        rows = asyncio.run(measure(lab, given.loops, given.seconds))
    print_rows(rows, as_json=given.json)


if __name__ == "__main__":
    main()
