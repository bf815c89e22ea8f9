"""Two nodes over a loopback that falls from 5 to 0.5 Mbit/s and recovers; prints queue and ages of boards.

Run by test_falling.py as `unshare --net python falling.py SECONDS`, which is the time at 0.5 Mbit/s. Offered
are items of a stream, 1.6 Mbit/s, one in 40 ms, and the state of a vehicle in each beacon. With `--at-once`
the link has 0.5 Mbit/s from the start, and the items begin with it.
"""

import asyncio
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

import uvloop
from tests.integration.broker.overload import ages_ms, commands_ms, drain, offer, share, until_measured, write
from tests.integration.broker.swarm import swarm

from swarmware.model.frame import FrameKind
from swarmware.types.net import ConnectionStatus
from swarmware.types.scalar import Text

FAST_BIT_S: Final = 5_000_000
SLOW_BIT_S: Final = 500_000
ITEM: Final = ("map/scan", FrameKind.STREAM, 8000, 25.0)
"""Path, kind, bytes and rate."""
BEFORE_S: Final = 3.0
SAMPLE_S: Final = 0.03
FALL_S: Final = 1.5
"""Time after the change that is counted on its own."""


def set_rate(verb: str, rate_bit_s: int) -> None:
    """Queue of 64 kB before the rate, as in `swarmctl lab link --rate`."""
    slow = f"tbf rate {rate_bit_s} burst 4kb limit 64kb"
    subprocess.run(["tc", "qdisc", verb, "dev", "lo", "root", *slow.split()], check=True)


async def watch_queue(into: list[float]) -> None:
    """Time that the queue of the link needs at the slow rate, again and again."""
    show = ("tc", "-s", "-j", "qdisc", "show", "dev", "lo")
    while True:
        done = await asyncio.to_thread(subprocess.run, show, capture_output=True, check=True)
        into.append(json.loads(done.stdout)[0]["backlog"] * 8e3 / SLOW_BIT_S)
        await asyncio.sleep(SAMPLE_S)


async def measure(root: Path, seconds: float, at_once: bool) -> dict[str, float]:
    async with swarm(root, "uav1", "uav2") as pair:
        one, two = pair["uav1"], pair["uav2"]
        loop = asyncio.get_running_loop()
        one.plan(offers=[("nav/note", Text)])
        two.plan(wants=[("uav1", "nav/note", Text)])
        await one.until_up("uav2")
        await two.until_up("uav1")
        path, kind, size, rate_hz = ITEM
        for taken in ("cmd/order", path):
            two.app.start(drain(two.app.inbox(taken, Text)), taken)
        board = two.app.reader("/uav1/nav/note", Text)
        one.app.start(write(one), "boards")
        ages: list[float] = []
        two.app.start(ages_ms(board, two, ages), "ages")
        if not at_once:
            await until_measured(one)
            await commands_ms(one, 1.0)
        queues: list[float] = []
        one.app.start(offer(one, path, kind, size, rate_hz), path)
        found: dict[str, float] = {}
        start_s = loop.time()

        def take(name: str) -> None:
            found[f"{name}_boards"] = len(ages)
            found[f"{name}_p99_ms"], found[f"{name}_p50_ms"] = share(ages, 0.99), share(ages, 0.5)
            ages.clear()
            if queues:
                found[f"{name}_queue_ms"] = max(queues)
                queues.clear()

        if not at_once:
            await asyncio.sleep(BEFORE_S)
            take("before")
            set_rate("change", SLOW_BIT_S)
            start_s = loop.time()

        async def switched() -> None:
            while True:
                table = one.neighbours.value
                if table is not None and table.neighbours[0].transport is ConnectionStatus.DATAGRAMS:
                    found["datagrams_after_s"] = loop.time() - start_s
                    return
                await one.neighbours.changed()

        one.app.start(switched(), "switched")
        one.app.start(watch_queue(queues), "queue")
        await asyncio.sleep(FALL_S)
        take("fall")
        commands = await commands_ms(one, seconds - FALL_S)
        found["command_p99_ms"] = share(commands, 0.99)
        take("slow")
        set_rate("change", FAST_BIT_S)
        await asyncio.sleep(FALL_S)
        take("after")
        return found


if __name__ == "__main__":
    at_once = "--at-once" in sys.argv
    subprocess.run(["ip", "link", "set", "lo", "mtu", "1500", "up"], check=True)
    set_rate("add", SLOW_BIT_S if at_once else FAST_BIT_S)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as folder,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        print(json.dumps(runner.run(measure(Path(folder), float(sys.argv[1]), at_once))))
