"""Messages over bad links of one and three hops, and links that are cut and healed, in a lab with a radio.

    python tests/bench/radio_links.py [--messages N] [--lab NAME] [--json]

Four nodes in namespaces (`swarmctl lab up --net netns --radio lan`), all their daemons running. Every link
loses 30 % of the frames in both directions and delays them by 10 ms each way; for three hops the others are
cut. Each message has 10 s. Then the links are perfect, and one is cut, then a node is away for 5 s. Needs the
rights of `--net netns`.
"""

import asyncio
import itertools
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parents[2]))
from lab import options, radio_lab
from rows import Row, print_rows

from swarmctl.session.labs import LabState
from swarmlab.radio.core.link import ImpairmentChange
from swarmlab.radio.orders import CutLinks, HealLinks, ImpairLinks, Links, RadioOrder, send
from swarmware.errors import NoAnswer
from swarmware.module.board import BoardReader
from swarmware.module.inbox import Inbox
from swarmware.module.module import Module
from swarmware.types.net import LinkStatus, Neighbours, Routes
from swarmware.types.scalar import Blob

NODES: Final = 4
OWN: Final = "bench-radio"
LOSS: Final = 0.3
DELAY_S: Final = 0.01
MESSAGE_BYTES: Final = 200
MESSAGE_S: Final = 0.2
TIMEOUT_S: Final = 10.0
AWAY_S: Final = 5.0
PROBE_S: Final = 0.05
PATIENCE_S: Final = 60.0
INBOX: Final = "bench/message"


async def drain(inbox: Inbox[Blob]) -> None:
    """Takes everything that arrives."""
    with suppress(NoAnswer):
        async for _ in inbox:
            pass


async def until(what: Callable[[], bool], reader: BoardReader[Any]) -> None:
    """Waits until the condition holds for a value of the board."""
    async with asyncio.timeout(PATIENCE_S):
        while not what():
            await reader.changed()


class Bench:
    """A lab, an application on each of its nodes, and the tables of the first one."""

    def __init__(self, lab: LabState, modules: dict[str, Module]) -> None:
        self._lab = lab
        self._modules = modules
        self.names = list(modules)
        self._first, self._last = self.names[0], self.names[-1]
        first = modules[self._first]
        self._module = first
        self._routes = {name: one.reader("net/routes", Routes) for name, one in modules.items()}
        self._neighbours = first.reader("net/neighbours", Neighbours)
        for one in modules.values():
            one.start(drain(one.inbox(INBOX, Blob)), "drain")

    def order(self, order: RadioOrder) -> None:
        """Has the radio change links."""
        send(Path(self._lab.folder), order)

    def both(self, *pairs: tuple[str, str]) -> Links:
        """Both directions of these links."""
        return tuple(itertools.chain.from_iterable(((a, b), (b, a)) for a, b in pairs))

    def all_links(self) -> Links:
        """Both directions of all links."""
        return self.both(*itertools.combinations(self.names, 2))

    def via(self, name: str, target: str) -> str:
        """Next hop of a node to another node, or "" without a route."""
        table = self._routes[name].value
        return next((r.via for r in table.routes if r.platform == target), "") if table is not None else ""

    def state(self, neighbour: str) -> LinkStatus:
        """State of the link of the first node to a neighbour."""
        table = self._neighbours.value
        found = [one.state for one in table.neighbours if one.platform == neighbour] if table else []
        return found[0] if found else LinkStatus.DOWN

    async def until_direct(self) -> None:
        """Waits until all nodes reach all others without a hop between."""
        for name, target in itertools.permutations(self.names, 2):
            await until(lambda name=name, target=target: self.via(name, target) == target, self._routes[name])  # type: ignore[misc]  # of this iteration

    async def message(self, target: str, timeout_s: float) -> tuple[str, float]:
        """Outcome of one message, and the time until its sender knew it."""
        loop = asyncio.get_running_loop()
        start_s = loop.time()
        outcome = await self._module.send(
            f"/{target}/{INBOX}", Blob(bytes(MESSAGE_BYTES)), timeout_s=timeout_s
        )
        return outcome.status.name.lower(), loop.time() - start_s

    async def messages(self, target: str, count: int) -> list[tuple[str, float]]:
        """Messages at a fixed rate, each on its own."""
        loop = asyncio.get_running_loop()
        start_s, sent = loop.time(), list[asyncio.Task[tuple[str, float]]]()
        for number in range(count):
            sent.append(asyncio.create_task(self.message(target, TIMEOUT_S), name=f"message {number}"))
            await asyncio.sleep(max(0.0, start_s + (number + 1) * MESSAGE_S - loop.time()))
        return list(await asyncio.gather(*sent))

    async def bad_links(self, count: int) -> list[Row]:
        """Messages over one and over three hops that lose and delay."""
        await self.until_direct()
        change = ImpairmentChange(loss_ratio=LOSS, delay_s=DELAY_S)
        self.order(ImpairLinks(self.all_links(), change))
        rows = [_message_row(1, await self.messages(self.names[1], count))]
        line = set(itertools.pairwise(self.names))
        self.order(
            CutLinks(self.both(*(pair for pair in itertools.combinations(self.names, 2) if pair not in line)))
        )
        for here, there, next_hop in (
            (self._first, self._last, self.names[1]),
            (self._last, self._first, self.names[-2]),
        ):
            await until(lambda h=here, t=there, n=next_hop: self.via(h, t) == n, self._routes[here])  # type: ignore[misc]  # of this iteration
        rows.append(_message_row(3, await self.messages(self._last, count)))
        self.order(HealLinks(self.all_links()))
        return rows

    async def cuts(self, times: int) -> list[Row]:
        """Loss of a neighbour, another route, and the first data of a node that returns."""
        lost, rerouted, first = list[float](), list[float](), list[float]()
        for _ in range(times):
            await self.until_direct()
            cut_ns = self._module.now_ns()
            self.order(CutLinks(self.both((self._first, self._last))))
            await until(lambda: self.state(self._last) is LinkStatus.DOWN, self._neighbours)
            table = self._neighbours.value
            assert table is not None
            lost += [(one.since_ns - cut_ns) / 1e9 for one in table.neighbours if one.platform == self._last]
            await until(
                lambda: self.via(self._first, self._last) not in ("", self._last), self._routes[self._first]
            )
            status = ""
            while status != "delivered":
                status, _ = await self.message(self._last, 1.0)
            rerouted.append((self._module.now_ns() - cut_ns) / 1e9)
            away = self.both(*((self._last, name) for name in self.names[:-1]))
            self.order(CutLinks(away))
            await asyncio.sleep(AWAY_S)
            self.order(HealLinks(away))
            healed_ns = self._module.now_ns()
            status = ""
            while status != "delivered":
                status, _ = await self.message(self._last, PROBE_S)
            first.append((self._module.now_ns() - healed_ns) / 1e9)
        return [
            _time_row("loss of a neighbour is detected", lost, 1.5),
            _time_row("message over another route, after the cut", rerouted, 2.0),
            _time_row(f"first message after a return from {AWAY_S:.0f} s", first, 1.0),
        ]


def _message_row(hops: int, outcomes: list[tuple[str, float]]) -> Row:
    """`outcomes`: of all messages; each of them has one, so all are delivered or their sender was told."""
    counts = Counter(status for status, _ in outcomes)
    times_s = sorted(time_s if status == "delivered" else TIMEOUT_S for status, time_s in outcomes)
    p99_s = times_s[int(0.99 * (len(times_s) - 1))]
    what = ", ".join(f"{count} {status}" for status, count in counts.most_common())
    p50_s = times_s[len(times_s) // 2]
    return Row(
        f"message, 30 % loss, 20 ms RTT a hop, hops: {hops}",
        f"{what} of {len(outcomes)}; p50 {p50_s * 1000:.0f} ms, p99 {p99_s * 1000:.0f} ms",
        "100 % delivered or reported; p99 < 1 s",
        p99_s < 1.0,
    )


def _time_row(name: str, times_s: list[float], goal_s: float) -> Row:
    shown = ", ".join(f"{time_s:.2f}" for time_s in times_s)
    return Row(name, f"{shown} s", f"< {goal_s:g} s", max(times_s) < goal_s)


async def measure(lab: LabState, count: int, times: int) -> list[Row]:
    """All rows of this lab."""
    async with AsyncExitStack() as stack:
        modules = {
            node.platform: await stack.enter_async_context(Module("bench", config_dir=node.config_dir))
            for node in lab.nodes
        }
        bench = Bench(lab, modules)
        return [*await bench.bad_links(count), *await bench.cuts(times)]


def main() -> None:
    """Measures and prints."""
    parser = options(__doc__)
    parser.add_argument("--messages", type=int, default=100)
    parser.add_argument("--cuts", type=int, default=3)
    given = parser.parse_args()
    with radio_lab(given.lab, OWN, NODES, "lan") as lab:
        rows = asyncio.run(measure(lab, given.messages, given.cuts))
    print_rows(rows, as_json=given.json)


if __name__ == "__main__":
    main()
