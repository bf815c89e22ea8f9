"""Processor time, wakes and memory of the nodes of a swarm of sixteen, at rest and in formation.

    python tests/bench/load16.py [--seconds S] [--lab NAME] [--json]

Wake-ups are the voluntary context switches of a node's threads. The
memory of a node is the sum over its processes: resident (RSS) counts what processes share in each of them,
proportional (PSS) divides it by their number. `--lab`: a running lab. No other load should run:
the nodes share the cores of this machine.
"""

import asyncio
import json
import os
import sys
import time
from pathlib import Path
from typing import Final, NamedTuple

from lab import formation_lab, options

from swarmctl.session.labs import LabState
from swarmctl.session.processes import NODE_MARK, by_mark
from swarmctl.session.session import connect
from swarmctl.terminal.table import Column, fitted_table
from swarmlab.experiment import PLAN, TASK, TASK_S, mission_task
from swarmlab.run import lifecycle
from swarmlab.run.watch import SwarmWatch
from swarmware.errors import SwarmError
from swarmware.types.mission import AbortAnswer, MissionAbort, MissionPlan, TaskAnswer

OWN: Final = "bench-load"
SETTLE_S: Final = 18.0
"""Clocks of new links need 15 s; after that beacons without changes are skipped."""
FORMED_S: Final = 12.0
"""From the order until every member moves: barriers, take-off, forming."""
TICK_S: Final = 1 / os.sysconf("SC_CLK_TCK")
ABORT: Final = MissionAbort("the bench has measured", "hold")


class Use(NamedTuple):
    """Resources that the processes of one node have used so far."""

    cpu_s: float
    main_wakes: int
    """Wake-ups of main threads."""
    other_wakes: int
    """Wake-ups of all other threads, which are the threads of libzmq, the mission daemon and the logger."""
    rss_mb: float
    pss_mb: float
    processes: int


def used(pids: list[int]) -> Use:
    """The sum over the processes of a node."""
    cpu_s, main_wakes, other_wakes, rss_kb, pss_kb = 0.0, 0, 0, 0, 0
    for pid in pids:
        folder = Path(f"/proc/{pid}")
        ticks = (folder / "stat").read_text().rsplit(")", 1)[1].split()
        cpu_s += (int(ticks[11]) + int(ticks[12])) * TICK_S
        for task in (folder / "task").iterdir():
            wakes = _field(task / "status", "voluntary_ctxt_switches")
            if task.name == str(pid):
                main_wakes += wakes
            else:
                other_wakes += wakes
        rss_kb += _field(folder / "smaps_rollup", "Rss")
        pss_kb += _field(folder / "smaps_rollup", "Pss")
    return Use(cpu_s, main_wakes, other_wakes, rss_kb / 1e3, pss_kb / 1e3, len(pids))


def _field(path: Path, name: str) -> int:
    for line in path.read_text().splitlines():
        key, _, value = line.partition(":")
        if key == name:
            return int(value.split()[0])
    raise SwarmError(f"{path}: no field {name}")


def of_nodes(lab: LabState) -> dict[str, list[int]]:
    """Platform → its processes."""
    found = by_mark(NODE_MARK)
    return {node.platform: [process.pid for process in found[node.folder]] for node in lab.nodes}


async def measure(lab: LabState, what: str, seconds: float) -> dict[str, object]:
    """The mean over the nodes, per second of a time span."""
    nodes = of_nodes(lab)
    before, began_s = {name: used(pids) for name, pids in nodes.items()}, time.monotonic()
    await asyncio.sleep(seconds)
    after, span_s = {name: used(pids) for name, pids in nodes.items()}, time.monotonic() - began_s
    cpu = {name: (after[name].cpu_s - before[name].cpu_s) / span_s * 100 for name in nodes}

    def mean(values: list[float]) -> float:
        return round(sum(values) / len(values), 2)

    return {
        "state": what,
        "cpu_percent": mean(list(cpu.values())),
        "cpu_percent_max": round(max(cpu.values()), 2),
        "main_wakes_per_s": mean([(after[n].main_wakes - before[n].main_wakes) / span_s for n in nodes]),
        "other_wakes_per_s": mean([(after[n].other_wakes - before[n].other_wakes) / span_s for n in nodes]),
        "rss_mb": mean([use.rss_mb for use in after.values()]),
        "pss_mb": mean([use.pss_mb for use in after.values()]),
        "processes": mean([use.processes for use in after.values()]),
        "cpu_percent_of_nodes": {name: round(value, 2) for name, value in cpu.items()},
    }


async def measure_all(lab: LabState, seconds: float) -> list[dict[str, object]]:
    """At rest, then while the mission is flown."""
    async with connect(lifecycle.station_settings(lab)) as session:
        watch = SwarmWatch.open(session)
        await watch.until_quiet(SETTLE_S)
    await asyncio.sleep(SETTLE_S)  # without a console, whose subscriptions are not part of a swarm at rest
    found = [await measure(lab, "at rest", seconds)]
    task = mission_task(lab.experiment)
    async with connect(lifecycle.station_settings(lab)) as session:
        await session.ask(PLAN, task, MissionPlan, timeout_s=TASK_S)
        answer = await session.ask(TASK, task, TaskAnswer, timeout_s=TASK_S)
        if not answer.accepted:
            raise SwarmError(f"not accepted: {[order for order in answer.orders if not order.accepted]}")
    await asyncio.sleep(FORMED_S)
    found.append(await measure(lab, "in formation", seconds))
    async with connect(lifecycle.station_settings(lab)) as session:
        await session.ask("sys/mission/abort", ABORT, AbortAnswer, timeout_s=10)
    return found


COLUMNS: Final = (
    Column("node"),
    Column("CPU", right=True),
    Column("max", right=True),
    Column("wakes/s", right=True),
    Column("other threads", right=True),
    Column("RSS", right=True),
    Column("PSS", right=True),
)


def main() -> int:
    """Measures and prints."""
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, default=12.0, help="of each of the two measurements")
    given = parser.parse_args()
    with formation_lab(given.lab, OWN) as lab:
        found = asyncio.run(measure_all(lab, given.seconds))
    if given.json:
        print(json.dumps(found, indent=1))
        return 0
    rows = [
        [
            str(row["state"]),
            f"{row['cpu_percent']} %",
            f"{row['cpu_percent_max']} %",
            str(row["main_wakes_per_s"]),
            str(row["other_wakes_per_s"]),
            f"{row['rss_mb']} MB",
            f"{row['pss_mb']} MB",
        ]
        for row in found
    ]
    print(fitted_table(COLUMNS, rows).text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
