"""What the tree costs: bytes at rest and of a join, by nodes; time of a query over 100 000 resources.

`python -m tests.bench.tree [NODES…]`; without an argument 16 and 200. Real cores, virtual time, the shipped
templates; each platform has one resource more than its template. Times are of the processor; `cold` is the
first search of a pattern in these trees. The bytes of a join are all that the last node sends and receives
because of it: frames with their headers, answers and repetitions, and the parts of beacons with structures,
signatures and questions, also those that it overhears. `former` nodes request each structure.
"""

import sys
from pathlib import Path
from time import process_time
from typing import Final

from swarmd.tree.core.structure.index import Index, leaf
from swarmware.model.resource import Resource

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.simulation.tree.cell import Cell

REST_S: Final = 60.0
BEACONS_HZ: Final = 2.0
"""Of a node at rest (ADR 23)."""
VERSION_BYTES: Final = 4
"""Version of the tree in a beacon."""
RUNS: Final = 5
SEEDS: Final = 5
PATTERNS: Final = (
    "/*/g1/m3/*", "/p7/**", "/*/**", "/*/**/r7", "/*/*/m3/r7", "/*/g*/m1*/r1", "/*/{g0,g1}/m3/*",
    "/*/**/m3/**",
)  # fmt: skip


def main() -> None:
    """Prints a line per figure."""
    for nodes in map(int, sys.argv[1:] or ("16", "200")):
        _traffic(nodes)
    for loss in (0.0, 0.1, 0.3):
        _join_with_loss(loss)
    _queries()


def _traffic(nodes: int) -> None:
    cell = Cell({}, nodes)
    names = list(cell.trees)
    for name in names[:-1]:
        cell.join(name)
        cell.run_for(1.0)
    last = names[-1]
    cell.join(last)
    cell.run_for(5.0)
    assert cell.complete()
    _print_join(f"{nodes} nodes", cell, last)
    cell.leave(last)
    cell.run_for(20.0)
    before = cell.bytes[last]
    cell.join(last)
    cell.run_for(5.0)
    print(f"{nodes} nodes, second visit: {cell.bytes[last] - before} B")
    sent = sum(cell.bytes.values())
    cell.run_for(REST_S)
    at_rest = (sum(cell.bytes.values()) - sent) / nodes / REST_S
    beacons = VERSION_BYTES * BEACONS_HZ
    print(f"{nodes} nodes, at rest: {at_rest:.1f} B/s of frames and {beacons:.1f} B/s in beacons, per node")


def _print_join(title: str, cell: Cell, last: str) -> None:
    structure, beacons, frames = cell.structure_bytes[last], cell.beacon_bytes[last], cell.frames[last]
    rest = cell.bytes[last] - structure
    print(
        f"{title}, join: {rest} B and {structure} B of structures; of these {beacons} B in beacons,"
        f" {cell.bytes[last] - beacons} B in {frames} frames"
    )


def _join_with_loss(loss: float) -> None:
    """The worst of some joins where frames and beacons are lost; also without structures in beacons."""
    for title, former in (("", False), (" former", True)):
        worst: Cell | None = None
        for seed in range(SEEDS):
            names = list(Cell({}).trees)
            cell = Cell({}, seed=seed, loss=loss, former=names if former else ())
            for name in names:
                cell.join(name)
                cell.run_for(10.0)
            assert cell.complete()
            if worst is None or cell.bytes[names[-1]] > worst.bytes[names[-1]]:
                worst = cell
        assert worst is not None
        _print_join(f"16{title} nodes, {loss:.0%} lost, worst of {SEEDS}", worst, names[-1])


def _queries() -> None:
    swarm = {
        f"p{number}": Index(
            leaf(Resource(path=f"g{i // 100}/m{i // 20}/r{i % 20}", type="Float", unit="m", owner="x"))
            for i in range(500)
        )
        for number in range(200)
    }
    one = {
        "p7": Index(
            leaf(Resource(path=f"g{i // 1000}/m{i // 20 % 50}/r{i % 20}", type="Float", unit="m", owner="x"))
            for i in range(100_000)
        )
    }
    for text in PATTERNS:
        first, _, rest = text[1:].partition("/")
        for title, trees in (("200 trees of 500", swarm), ("one tree of 100000", one)):
            took, count = [], 0
            for _ in range(RUNS):
                began = process_time()
                chosen = trees.values() if first == "*" else [trees[first]]
                count = sum(len(index.match(rest)) for index in chosen)
                took.append(process_time() - began)
            cold_ms, warm_ms = took[0] * 1e3, min(took[1:]) * 1e3
            print(f"{text:16} {title:18} {count:6} found: cold {cold_ms:7.2f} ms, warm {warm_ms:6.2f} ms")


if __name__ == "__main__":
    main()
