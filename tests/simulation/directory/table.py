"""The tables of the directory, of dense cells and of boot storms, computed in virtual time.

    python -m tests.simulation.directory.table [moving | cell | storm] [--nodes N] [--speed V] [--loss P]
                                               [--seed N]

Prints Markdown. The figures depend on the seeds only, not on the machine; the processor time is printed to
stderr.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from tests.simulation.directory.cell import Cell
from tests.simulation.directory.flight import fly
from tests.simulation.directory.storm import Storm
from tests.simulation.directory.swarm import Swarm

COMMAND: Final = "python -m tests.simulation.directory.table"
SPEEDS_M_S: Final = (0, 3, 10)
STORM_NODES: Final = 16
STORM_SEEDS: Final = 10
LOSSES_PERCENT: Final = (2, 30)


class MovingRow(NamedTuple):
    """How swarms of one size are measured."""

    seeds: int
    warm_s: float
    seconds: float
    budget_bytes_s: int
    """Of the sections about links and routes, per node."""


class CellRow(NamedTuple):
    """How a cell of one size is measured."""

    whole: int
    """Nodes that are whole brokers."""
    warm_s: float
    seconds: float


MOVING: Final = {
    16: MovingRow(4, 6, 10, 240),
    50: MovingRow(2, 6, 8, 450),
    100: MovingRow(1, 8, 6, 720),
    200: MovingRow(1, 11, 4, 975),
}
CELLS: Final = {
    16: CellRow(16, 20, 20),
    100: CellRow(3, 40, 20),
    200: CellRow(3, 60, 20),
    500: CellRow(1, 150, 20),
}
MOVING_HEAD: Final = (
    "| nodes, speed | pairs with a route (worst seed) | directory B/s (highest node; budget) |"
    " whole beacons B/s | stretch | outages median / p95 | loops / changed routes | seeds × measured |"
    " command |\n|---|---|---|---|---|---|---|---|---|"
)
CELL_HEAD: Final = (
    "| nodes | airtime | beacons of a node | links up | link changes | age of poses median / p95 |"
    " whole brokers, measured | command |\n|---|---|---|---|---|---|---|---|"
)
STORM_HEAD: Final = (
    "| nodes | loss | complete after, median (worst seed) | seeds | command |\n|---|---|---|---|---|"
)


def moving(nodes: int, speed_m_s: float, first_seed: int = 1) -> str:
    """The row of swarms of one size at one speed."""
    row = MOVING[nodes]
    command = f"moving --nodes {nodes} --speed {speed_m_s:g}"
    if first_seed != 1:
        command += f" --seed {first_seed}"
    flights = [
        fly(Swarm(seed, nodes, speed_m_s=speed_m_s), row.warm_s, row.seconds)
        for seed in range(first_seed, first_seed + row.seeds)
    ]
    routed = [flight.routed_ratio for flight in flights]
    outages_s = [outage_s for flight in flights for outage_s in flight.outages_s]
    median_s, high_s = np.quantile(np.array(outages_s or [0.0]), (0.5, 0.95))
    return (
        f"| {nodes}, {speed_m_s:g} m/s | {np.mean(routed):.2%} ({min(routed):.2%})"
        f" | {np.mean([flight.directory_bytes_s for flight in flights]):.0f}"
        f" ({max(flight.directory_max_bytes_s for flight in flights):.0f}; {row.budget_bytes_s})"
        f" | {np.mean([flight.beacon_bytes_s for flight in flights]):.0f}"
        f" | {np.mean([flight.stretch for flight in flights]):.2f}"
        f" | {f'{median_s:.2f} / {high_s:.2f} s, {len(outages_s)} in all' if outages_s else 'none'}"
        f" | 0 / {sum(flight.changes for flight in flights)}"
        f" | {row.seeds} × {row.seconds:g} s | `{command}` |"
    )


def dense_cell(nodes: int) -> str:
    """The row of a cell of one size."""
    row = CELLS[nodes]
    cell = Cell(1, nodes, row.whole)
    cell.run_for(row.warm_s)
    found = cell.measure(row.seconds)
    median_s, high_s = np.quantile(np.array(found.ages_s), (0.5, 0.95))
    return (
        f"| {nodes} | {found.air_ratio:.1%} | {found.sent_hz:.2f} Hz | {found.links_ratio:.1%}"
        f" | {found.changes_hz:.2f} /s | {median_s:.2f} / {high_s:.2f} s"
        f" | {row.whole}, {row.seconds:g} s | `cell --nodes {nodes}` |"
    )


def boot_storm(nodes: int, loss_percent: float) -> str:
    """The row of a boot storm."""
    times_s = [Storm(seed, nodes, loss=loss_percent / 100).converge_s() for seed in range(STORM_SEEDS)]
    return (
        f"| {nodes} | {loss_percent:g} % | {np.median(times_s):.2f} s ({max(times_s):.2f} s)"
        f" | {STORM_SEEDS} | `storm --loss {loss_percent:g}` |"
    )


def rows(options: argparse.Namespace) -> Iterator[str]:
    """The rows that the options select."""
    if options.table in (None, "moving"):
        yield MOVING_HEAD
        for nodes in MOVING if options.nodes is None else (options.nodes,):
            for speed_m_s in SPEEDS_M_S if options.speed is None else (options.speed,):
                yield moving(nodes, speed_m_s, options.seed)
    if options.table in (None, "cell"):
        yield CELL_HEAD
        for nodes in CELLS if options.nodes is None else (options.nodes,):
            yield dense_cell(nodes)
    if options.table in (None, "storm"):
        yield STORM_HEAD
        for loss in LOSSES_PERCENT if options.loss is None else (options.loss,):
            yield boot_storm(STORM_NODES, loss)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Reads the command line.

    Raises: SystemExit for a command line that selects no row.
    """
    parser = argparse.ArgumentParser(prog=COMMAND, description="Tables of swarms in virtual time.")
    parser.add_argument("table", nargs="?", choices=("moving", "cell", "storm"), help="default: all")
    parser.add_argument("--nodes", type=int, help="the rows of this size only")
    parser.add_argument("--speed", type=float, metavar="V", help="the rows of this speed in m/s only")
    parser.add_argument("--loss", type=float, metavar="P", help="the rows of this loss in percent only")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="first seed of moving swarms")
    options = parser.parse_args(arguments)
    sizes = {"moving": tuple(MOVING), "cell": tuple(CELLS), "storm": (STORM_NODES,)}
    if options.nodes is not None and options.nodes not in sizes.get(options.table, ()):
        parser.error(f"--nodes {options.nodes}: expected a table and one of its sizes: {sizes}")
    return options


def main() -> None:
    """Computes and prints."""
    for row in rows(parse(sys.argv[1:])):
        print(row, flush=True)
        print(f"{time.process_time():.0f} s of processor time", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
