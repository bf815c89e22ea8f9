"""The experiment of sixteen nodes beside its budgets; fails when one is missed.

`make bench`, or `python tests/bench/formation16.py [DIR]`: the report goes there. Nothing else should run:
the sixteen nodes share the cores of this machine, and its load is printed beside the figures.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from swarmctl.terminal.table import Column, fitted_table
from swarmlab.experiment import REPORT
from swarmlab.report.report import LIMITS, ExperimentReport

NODES: Final = 16


class Budget(NamedTuple):
    """One figure and its upper limit."""

    what: str
    figure: Callable[[ExperimentReport], float | None]
    limit: float
    unit: str


BUDGETS: Final = (
    Budget("ready", lambda r: r.ready_s, LIMITS.ready_s, "s"),
    Budget("command to receipt, p50", lambda r: r.command_to_receipt_ms.p50, LIMITS.receipt_p50_ms, "ms"),
    Budget("command to receipt, p99", lambda r: r.command_to_receipt_ms.p99, LIMITS.receipt_p99_ms, "ms"),
    Budget("formation error, mean", lambda r: r.formation_error_m.mean, LIMITS.formation_error_m, "m"),
    Budget("bytes per notification", lambda r: r.bytes_per_notification, LIMITS.bytes_per_notification, "B"),
    Budget("egress per node (S0: 14.89)", lambda r: r.traffic.egress_kbps, 4.7, "kB/s"),
    Budget("global traffic (S0: 56.07)", lambda r: r.traffic.global_kbps, 16 * 4.7, "kB/s"),
    Budget("clock error, p95", lambda r: r.clock_error_us.p95, 100.0, "µs"),
)


def main() -> int:
    """Runs the experiment and prints the table; 1 when a budget is missed."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch)
        call = [sys.executable, "-m", "swarmctl", "lab", "run", "formation", "--nodes", str(NODES)]
        done = subprocess.run(
            [*call, "--quiet", "--out", str(folder)], stdout=subprocess.DEVNULL, check=False
        )
        if done.returncode not in {0, 3}:
            return done.returncode
        found = msgspec.json.decode((folder / REPORT).read_bytes(), type=ExperimentReport)
    rows = []
    missed = 0
    for budget in BUDGETS:
        value = budget.figure(found)
        held = value is not None and value < budget.limit
        missed += not held
        shown = "-" if value is None else f"{value:.4g} {budget.unit}"
        rows.append([budget.what, shown, f"< {budget.limit:g} {budget.unit}", "" if held else "MISSED"])
    print(f"{NODES} nodes, one formation; {found.host.summary()}")
    print(
        fitted_table(
            (Column("figure"), Column("here", right=True), Column("budget", right=True), Column("")), rows
        ).text
    )
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
