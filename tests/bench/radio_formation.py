"""The formation of sixteen nodes over the radio `s3`: whether it is completed, and without collisions.

    python tests/bench/radio_formation.py [--nodes N] [--json]

`swarmctl lab run formation --net netns`: one namespace for each node, positions from the simulation. Needs
the rights of `--net netns`.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import msgspec
from rows import Row, print_rows

from swarmlab.experiment import REPORT
from swarmlab.report.report import ExperimentReport


def flown(nodes: int) -> Row:
    """Flies it. Raises: CalledProcessError when the lab cannot be run."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "swarmctl", "--quiet", "lab", "run", "formation"]
        command += ["--nodes", str(nodes), "--net", "netns", "--out", folder]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
        if done.returncode not in {0, 1, 3}:
            raise subprocess.CalledProcessError(done.returncode, command)
        found = msgspec.json.decode((Path(folder) / REPORT).read_bytes(), type=ExperimentReport)
    receipt = found.command_to_receipt_ms
    return Row(
        f"`lab run formation --net netns` with the radio `s3`, {nodes} nodes",
        f"{'completed' if found.completed else 'not completed'} in {found.duration_s:.1f} s,"
        f" {found.collisions} collisions; ready {found.ready_s:.0f} s,"
        f" command to receipt p99 {receipt.p99:.0f} ms, frames lost {found.frames_lost}",
        "complete, 0 collisions",
        found.completed and found.collisions == 0,
    )


def main() -> int:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--nodes", type=int, default=16)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    print_rows([flown(given.nodes)], as_json=given.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
