"""When nodes notice that a link is cut, at rest and with data: whole broker cores in virtual time.

    python tests/bench/link_notice.py [--cuts N] [--json]

Three nodes in range of each other; the link between two of them is cut, and healed after ten seconds. With
data one subscribes to a board of the other, whose beacons then leave at 10 Hz; at rest all send 2 Hz. All
links lose the same share of the datagrams. The figures depend on the seeds only, not on the machine.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))
from rows import Row, print_rows
from tests.simulation.directory.link_loss import middle, outages, worst

GOAL_NOTICED_S: Final = 1.5
GOAL_REROUTED_S: Final = 2.0
GOAL_BACK_S: Final = 1.0
LOSSES: Final = (0.0, 0.3)


def rows(cuts: int) -> Iterator[Row]:
    """The rows of both beacon rates and all losses."""
    for busy, rate in ((True, "10 Hz"), (False, "2 Hz (at rest)")):
        for loss in LOSSES:
            found = outages(range(1, cuts + 1), loss=loss, busy=busy)
            half, most = middle(found), worst(found)
            case = f"beacons at {rate}, {loss:.0%} loss"
            for name, field, goal_s in (
                ("loss of a neighbour is detected", "noticed", GOAL_NOTICED_S),
                ("route over another node, after the cut", "rerouted", GOAL_REROUTED_S),
                ("frames go directly again, after the return", "frames_back", GOAL_BACK_S),
            ):
                half_s, most_s = getattr(half, field), getattr(most, field)
                figure = f"{half_s:.2f} s, at most {most_s:.2f} s in {cuts} cuts"
                yield Row(f"{name}: {case}", figure, f"< {goal_s:g} s", most_s < goal_s)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--cuts", type=int, default=30)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    print_rows(rows(given.cuts), as_json=given.json)


if __name__ == "__main__":
    main()
