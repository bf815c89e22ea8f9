"""Kills the daemons of a node one after the other; each must be back, and each end must be counted once.

`python -m tests.integration.guard.steady_kills --count 100` does so every three seconds, with one process for
each daemon and with one for all, and prints the distribution; exit code 1 when one took longer than a second.
"""

import argparse
import asyncio
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final, Literal

from tests.integration.guard.kills import SERVICES, kill, node, whole

from swarmware.errors import NoAnswer
from swarmware.module.module import Module
from swarmware.types.health import GuardStatus

LIMIT_S: Final = 1.0
EVERY_S: Final = 3.0
GUARD: Final = "guard"

Processes = Literal["one", "per-daemon"]


async def run(
    root: Path,
    processes: Processes,
    victims: Sequence[str],
    say: Callable[[str], None],
    *,
    every_s: float = 0.0,
    between: Callable[[], Awaitable[None]] | None = None,
) -> list[float]:
    """Kills the process of each of these daemons, when the node is whole; the seconds until it is so again.

    Raises: NoAnswer when it is not whole again, or when more or fewer ends were counted than there were.
    """
    took: list[float] = []
    counted = 0
    async with node(root, processes) as (config, parent):
        for number, name in enumerate(victims, 1):
            if between is not None:
                await between()
            said = len(parent.stderr())
            began_s = time.monotonic()
            harm = kill(root, [name])
            took.append(await whole(root, config, began_s, harm.killed))
            say(f"{took[-1]:6.2f} s  {name}")
            counted += name != GUARD
            if processes == "one":
                correct = f"(restart {number})" in parent.stderr()[said:]
            else:
                async with Module("counter", config_dir=config) as module:
                    status = module.reader("guard/status", GuardStatus).value
                correct = status is not None and status.restarts == counted
            if not correct or took[-1] > LIMIT_S:
                say(parent.stderr()[said:])
            if not correct:
                raise NoAnswer(f"{name}: kill {number} was not counted once")
            await asyncio.sleep(max(0.0, began_s + every_s - time.monotonic()))
    return took


def main() -> int:
    """The command line."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=100, help="kills in each mode")
    options.add_argument("--processes", choices=["one", "per-daemon"])
    options.add_argument("--every", type=float, default=EVERY_S, metavar="SECONDS")
    given = options.parse_args()
    modes: tuple[Processes, ...] = ("per-daemon", "one")
    slow = 0
    for mode in modes if given.processes is None else (given.processes,):
        victims = [SERVICES[number % len(SERVICES)] for number in range(given.count)]
        with tempfile.TemporaryDirectory(prefix="sw") as folder:
            took_s = sorted(
                asyncio.run(run(Path(folder), mode, victims, partial(print, flush=True), every_s=given.every))
            )
        over = sum(one_s > LIMIT_S for one_s in took_s)
        print(
            f"{mode}: {len(took_s)} kills: p50 {took_s[len(took_s) // 2]:.2f} s, "
            f"max {took_s[-1]:.2f} s; {over} over {LIMIT_S:g} s",
            flush=True,
        )
        slow += over
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
