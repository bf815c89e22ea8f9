"""The formation over the radio `s3`, and in one cell of 32 nodes: whether it completes without collisions.

    python tests/bench/formations.py [--case radio|cell] [--json]

The radio has a namespace for each of 16 nodes, with positions from the simulation, and needs the rights of
`--net netns`. In one cell all 32 nodes receive each other, on the processors of this machine.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

import msgspec
from rows import Row, print_rows

from swarmlab.experiment import REPORT
from swarmlab.report.report import ExperimentReport

CASES: Final = {
    "radio": ("`lab run formation --net netns` with the radio `s3`, 16 nodes", ("16", "--net", "netns")),
    "cell": ("`lab run formation`, 32 nodes in one cell", ("32",)),
}
"""Name of the row, and the number of nodes with further options."""


def flown(case: str) -> Row:
    """Flies it; a lab that does not start, or a mission that is refused, is a goal that is missed."""
    name, options = CASES[case]
    goal = "complete, 0 collisions"
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "swarmctl", "--quiet", "lab", "run", "formation", "--out", folder]
        done = subprocess.run([*command, "--nodes", *options], stdout=subprocess.DEVNULL, check=False)
        report = Path(folder) / REPORT
        if not report.exists():
            return Row(name, f"not flown, exit code {done.returncode}", goal, False)
        found = msgspec.json.decode(report.read_bytes(), type=ExperimentReport)
    receipt = found.command_to_receipt_ms
    return Row(
        name,
        f"{'completed' if found.completed else 'not completed'} in {found.duration_s:.1f} s,"
        f" {found.collisions} collisions; ready {found.ready_s:.0f} s,"
        f" command to receipt p99 {receipt.p99:.0f} ms, frames lost {found.frames_lost}",
        goal,
        found.completed and found.collisions == 0,
    )


def main() -> int:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--case", choices=sorted(CASES), action="append")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    print_rows((flown(case) for case in given.case or CASES), as_json=given.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
