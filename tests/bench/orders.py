"""Instruction to receipt and to the last answer, over the number of nodes, beside a bare fan-out with CURVE.

    python tests/bench/orders.py [--nodes 3,6,10,16] [--orders N] [--lab NAME] [--json]

The orders of a swarm are given one after the other; the first one after the start is reported separately.
The bare fan-out sends as many messages from one process to others, each of which works beside it for as much
of a core as a node at rest. A ratio is refused if its bare figure is more than 20 % above the best of three
that are taken before. `--lab`: a running lab, whose figures alone are reported. No other load should run: the
nodes share the cores of this machine.
"""

import asyncio
import statistics
import sys
from collections.abc import Iterator
from time import monotonic_ns
from typing import Final

import numpy as np
from fanout import FanOut
from lab import NODES, formation_lab, options
from rows import REFUSED, Bare, Row, print_rows

from swarmctl.session.labs import LabState
from swarmctl.session.session import Session, connect
from swarmlab.experiment import PLAN, TASK, TASK_S, mission_task
from swarmlab.measure.clocks import ClockTruth
from swarmlab.report.report import LIMITS
from swarmlab.run import lifecycle
from swarmlab.run.watch import SwarmWatch
from swarmware.types.mission import AbortAnswer, MissionAbort, MissionPlan, TaskAnswer

OWN: Final = "bench-orders"
QUIET_S: Final = 15.0
ABORT: Final = MissionAbort("the bench gives the next order", "hold")
BETWEEN_S: Final = 3.0
"""Time from an abort to the next order, in which all vehicles hold and all states are published."""
AT_REST: Final = 0.04
"""Share of a core that a node at rest uses beside its orders."""
BURSTS: Final = 10
RATIO: Final = 5.0
"""Goal of the median, in multiples of the one of the bare fan-out."""


class Order:
    """The delays of one instruction, in true time."""

    def __init__(self, lab: LabState, answer: TaskAnswer, took_ms: float) -> None:
        clocks = {node.platform: ClockTruth(node.offset_s, node.drift_ppm).clock for node in lab.nodes}
        station = clocks["gcs"]
        instructed_ns = station.to_mono_ns(answer.instructed_ns)
        orders = [order for order in answer.orders if order.platform != "gcs"]
        received_ns = [clocks[order.platform].to_mono_ns(order.received_ns) for order in orders]
        self.command_ms = [(at_ns - instructed_ns) / 1e6 for at_ns in received_ns]
        """From the instruction to each receipt."""
        self.way_ms = [
            (at_ns - station.to_mono_ns(order.sent_ns)) / 1e6
            for at_ns, order in zip(received_ns, orders, strict=True)
        ]
        """From the sending of each order to its receipt."""
        self.last_answer_ms = (
            station.to_mono_ns(max(order.acked_ns for order in orders)) - instructed_ns
        ) / 1e6
        self.took_ms = took_ms
        """Until the operator had the answer to the instruction."""


async def _ordered(session: Session, lab: LabState) -> Order:
    """One order, aborted as soon as all members have it."""
    began_ns = monotonic_ns()
    answer = await session.ask(TASK, mission_task(lab.experiment), TaskAnswer, timeout_s=TASK_S)
    took_ms = (monotonic_ns() - began_ns) / 1e6
    if not answer.accepted:
        raise SystemExit(f"not accepted: {[order for order in answer.orders if not order.accepted]}")
    await session.ask("sys/mission/abort", ABORT, AbortAnswer, timeout_s=10)
    await asyncio.sleep(BETWEEN_S)
    return Order(lab, answer, took_ms)


async def measure(lab: LabState, count: int) -> tuple[Order, list[Order]]:
    """The first order after the start, and this many later ones."""
    async with connect(lifecycle.station_settings(lab)) as session:
        watch = SwarmWatch.open(session)
        await watch.until_quiet(QUIET_S)
        # as `mission start`: who would take part is asked before the instruction is given
        await session.ask(PLAN, mission_task(lab.experiment), MissionPlan, timeout_s=TASK_S)
        first = await _ordered(session, lab)
        return first, [await _ordered(session, lab) for _ in range(count)]


def _row(name: str, values: list[float], goals: tuple[float, float], refusal: str = "") -> Row:
    """A distribution beside the goals of its median and its 99th percentile."""
    p50, p99 = (float(value) for value in np.percentile(values, [50, 99]))
    figure = f"p50 {p50:.1f}, p99 {p99:.1f}, max {max(values):.1f} ms of {len(values)}"
    is_met = p50 < goals[0] and p99 < goals[1]
    return Row(name, figure, f"p50 < {goals[0]:g}, p99 < {goals[1]:g} ms", is_met, refusal)


def rows(lab: LabState, orders: int) -> tuple[list[Row], float]:
    """The rows of a running swarm, and the median delay to a receipt."""
    first, later = asyncio.run(measure(lab, orders))
    receipt, answer = (LIMITS.receipt_p50_ms, LIMITS.receipt_p99_ms), (LIMITS.last_answer_ms,) * 2
    command_ms = [ms for order in later for ms in order.command_ms]
    nodes = f"{len(lab.nodes)} nodes"
    return [
        _row(f"{nodes}: first order, command to receipt", first.command_ms, receipt),
        _row(f"{nodes}: later orders, command to receipt", command_ms, receipt),
        _row(f"{nodes}: later orders, their way", [ms for order in later for ms in order.way_ms], receipt),
        _row(f"{nodes}: first order, last answer", [first.last_answer_ms], answer),
        _row(f"{nodes}: later orders, last answer", [order.last_answer_ms for order in later], answer),
        _row(f"{nodes}: answer at the operator", [order.took_ms for order in later], (30.0, 60.0)),
    ], statistics.median(command_ms)


def compared(nodes: int, orders: int) -> Iterator[Row]:
    """The rows of a swarm of this size, then its ratio."""

    def bare_ms() -> float:
        with FanOut.of(nodes - 1, AT_REST) as fan_out:
            fan_out.receipts_ms(2)  # the first messages of connections
            return statistics.median(fan_out.receipts_ms(BURSTS))

    bare = Bare.measured(bare_ms)
    with formation_lab("", OWN, nodes) as lab:
        found, median_ms = rows(lab, orders)
    yield from found
    beside_ms = bare_ms()
    refusal, ratio = bare.refusal(beside_ms), median_ms / beside_ms
    figure = f"{ratio:.1f} × a bare fan-out with CURVE, {beside_ms:.2f} ms"
    name = f"{nodes} nodes: median of later orders"
    yield Row(name, figure, f"≤ {RATIO:g} ×", ratio <= RATIO, refusal)


def main() -> int:
    """Measures; 1 when a goal is missed, 3 when a ratio was refused."""
    parser = options(__doc__)
    parser.add_argument("--orders", type=int, default=8, help="after the first one")
    parser.add_argument("--nodes", default=f"3,6,10,{NODES}", help="numbers of nodes, the station included")
    given = parser.parse_args()
    found: list[Row] = []
    if given.lab:
        with formation_lab(given.lab, OWN) as lab:
            found = rows(lab, given.orders)[0]
        print_rows(found, as_json=given.json)
    else:
        for nodes in map(int, given.nodes.split(",")):
            for row in compared(nodes, given.orders):
                print_rows([row], as_json=given.json)
                found.append(row)
    if any(row.refusal for row in found):
        return REFUSED
    return int(not all(row.is_met for row in found))


if __name__ == "__main__":
    sys.exit(main())
