"""A link is cut and comes back: times until nodes notice it, go around it, and have data again.

    python tests/bench/link_loss.py [--json]

The cores in virtual time, 50 seeds each, with and without loss; three brokers with serial lines in real time,
five times; and 16 nodes that all start within one second.
"""

import argparse
import asyncio
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

import uvloop

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.integration.broker.cut_line import cut_and_heal
from tests.simulation.directory.link_loss import middle, outages, worst
from tests.simulation.directory.storm import Storm

SEEDS: Final = range(1, 51)
STORMS: Final = range(1, 21)
NODES: Final = 16
REAL: Final = 5
GOALS_S: Final = (1.5, 2.0, 1.0)
"""Loss of a neighbour, route over another one, first data after the return."""


class Line(NamedTuple):
    """A line of the table of link losses."""

    case: str
    median_s: float
    worst_s: float
    goal_s: float | None


def virtual_lines() -> Iterator[Line]:
    """Outages in virtual time."""
    for loss in (0.0, 0.1, 0.3):
        found = outages(SEEDS, loss=loss)
        half, most = middle(found), worst(found)
        for case, at, goal_s in (
            ("neighbour lost", 0, GOALS_S[0]),
            ("route over another one", 1, GOALS_S[1]),
            ("first board after the return", 2, GOALS_S[2]),
            ("frames directly after the return", 3, GOALS_S[2]),
        ):
            yield Line(f"{case}, {loss:.0%} loss", half[at], most[at], None if loss else goal_s)


def real_lines() -> Iterator[Line]:
    """The same with real brokers, and messages."""
    found: list[dict[str, float]] = []
    for _ in range(REAL):
        with (
            tempfile.TemporaryDirectory(prefix="sw") as folder,
            asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
        ):
            found.append(runner.run(cut_and_heal(Path(folder))))
    for case, key, goal_s in (
        ("brokers: neighbour lost", "noticed_s", GOALS_S[0]),
        ("brokers: route over another one", "rerouted_s", GOALS_S[1]),
        ("brokers: message over another one", "around_s", None),
        ("brokers: first message after the return", "back_s", GOALS_S[2]),
        ("brokers: direct route in use again", "direct_s", None),
    ):
        times = [one[key] for one in found]
        yield Line(case, median(times), max(times), goal_s)


def storm_lines() -> Iterator[Line]:
    """Nodes that start within one second."""
    for loss in (0.0, 0.02, 0.3):
        times = [Storm(seed, NODES, loss=loss).converge_s() for seed in STORMS]
        yield Line(
            f"{NODES} nodes at once, all routes and poses, {loss:.0%} loss", median(times), max(times), None
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    lines = [*virtual_lines(), *storm_lines(), *real_lines()]
    if arguments.json:
        print(json.dumps([line._asdict() for line in lines]))
        return
    for line in lines:
        goal = "" if line.goal_s is None else f"  goal {line.goal_s:g} s"
        print(f"{line.case:48} median {line.median_s:5.2f} s  worst {line.worst_s:5.2f} s{goal}")


if __name__ == "__main__":
    main()
