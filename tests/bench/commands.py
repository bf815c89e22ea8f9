"""Time of each command that reads, in a process of its own, beside a bare Python; fails above the limit.

    python tests/bench/commands.py [--runs N] [--lab NAME] [--json]

The median of the runs from the start of the process to its end, answer of the swarm included; runs of the
bare Python alternate with the runs of each command. `--lab`: a running lab with the platform `uav1`. A row is
refused if its bare figure is more than 20 % above the best of three that are taken at the start.
"""

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Sequence
from time import perf_counter
from typing import Final, NamedTuple

from lab import formation_lab, options
from rows import REFUSED, Bare

from swarmctl.main import SECTIONS
from swarmctl.terminal.table import Column, fitted_table

OWN: Final = "bench-commands"
NODES: Final = 6
LIMIT_RATIO: Final = 11.0
"""By the time of a bare Python: 150 ms where that takes 13.6 ms."""
HELP_RATIO: Final = 4.0
"""The same for the help of the program, which imports no command: the import of click bounds it."""
RUNS: Final = 9
COMMANDS: Final = (
    "--version",
    "--help",
    "completion bash",
    "node ls",
    "node info uav1",
    "app ls -n uav1",
    "tree ls",
    "tree ls /uav1",
    "tree show /uav1",
    "tree get /uav1/nav/pose",
    "tree type Pose",
    "tree log -n uav1",
    "tree diff uav1 ugv1",
    "tree dump /uav1/nav",
    "tree lint --templates",
    "call /uav1/sys/node/info",
    "wait /uav1/nav/pose age()<60 --timeout 5",
    "topo",
    "link ls",
    "link outages",
    "traffic channels",
    "traffic needs --capacity 1mbit",
    "traffic ls",
    "mission ls",
    "mission status",
    "mission queue",
    "mission history",
    "mission check formation",
    "hal ls",
    "time ls",
    "health ls",
    "health ready",
    "health faults",
    "health info uav1",
    "log query /uav1/nav/pose --limit 5",
    "log stats",
    "config get navigator/* -n uav1",
    "config describe navigator/altitude_kp -n uav1",
    "config diff -n uav1",
    "config dump -n uav1",
    "config history -n uav1",
    "lab ls",
    "lab env uav1",
    "lab logs gcs",
)
"""Commands that a person waits for, and the help of each top command."""
NOT_MEASURED: Final = {
    "acts": "node restart, node drain, node undrain, node add, node remove,"
    " node rename, app restart, app start, app stop, tree set, tree undo,"
    " tree rule, tree load, pub,"
    " traffic clear, traffic set, traffic undo,"
    " video start, video rate, video stop, mission start, mission abort, mission cancel, mission import,"
    " mission prioritize, mission answer, takeoff, goto, drive,"
    " hold, land, return, arm, disarm, kill, health clear,"
    " hal calibrate,"
    " config set, config undo, config load, keys init, keys join, keys invite, keys revoke, keys rotate,"
    " host install, host uninstall, fleet push, fleet up, fleet down, fleet upgrade, fleet exec,"
    " lab up, lab down, lab run, lab link, lab cut, lab heal, lab partition,"
    " new block, new driver, new mission, new module, new service",
    "runs until a signal or for a time": "tree bw, tree delay, tree hz, tree watch, traffic top,"
    " mission watch, log tail",
    "imports every service, whose settings it checks": "doctor, config show",
    "takes as long as the log is large": "log export, lab report",
    "needs the service files, or takes as long as a file is large": "file ls, file send, file get",
    "takes as long as the hosts and the network": "fleet ls",
    "opens a browser": "docs",
    "needs a service that a lab does not run": "video ls",
    "verifies a signature": "keys ls, keys show",
}
"""All other commands, by the reason."""


PYTHON: Final = (sys.executable, "-c", "pass")


def medians_ms(commands: Sequence[Sequence[str]], runs: int, env: dict[str, str]) -> list[float]:
    """Times of processes that alternate; a command that fails ends the measurement."""
    took: list[list[float]] = [[] for _ in commands]
    for _ in range(runs):
        for command, times in zip(commands, took, strict=True):
            began = perf_counter()
            done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
            times.append((perf_counter() - began) * 1000)
            if done.returncode:
                raise SystemExit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stderr}")
    return [statistics.median(times) for times in took]


class Found(NamedTuple):
    """The measured row of a command."""

    ms: float
    python_ms: float
    refusal: str
    limit: float
    """By the time of a bare Python."""

    @property
    def is_missed(self) -> bool:
        """Whether it takes longer than its limit, in a row that counts."""
        return self.ms > self.limit * self.python_ms and not self.refusal

    @property
    def verdict(self) -> str:
        """Words for a row that is refused or missed its limit."""
        return f"REFUSED: {self.refusal}" if self.refusal else "MISSED" if self.is_missed else ""


def main() -> int:
    """Measures and prints; not 0 when a limit is missed or a row refused."""
    parser = options(__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    args = parser.parse_args()
    with formation_lab(args.lab, OWN, NODES) as lab:
        env = {**os.environ, "SWARMCTL_LAB": lab.name, "NO_COLOR": "1"}
        env.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed package is compiled
        helps = [f"{name} --help" for section in SECTIONS.values() for name in section]
        bare = Bare.measured(lambda: medians_ms([PYTHON], args.runs, env)[0])
        found: dict[str, Found] = {}
        for line in (*COMMANDS, *helps):
            command = [sys.executable, "-m", "swarmctl", *line.split()]
            ms, python_ms = medians_ms([command, PYTHON], args.runs, env)
            limit = HELP_RATIO if line == "--help" else LIMIT_RATIO
            found[line] = Found(ms, python_ms, bare.refusal(python_ms), limit)
    if args.json:
        rows_of = {line: row._asdict() for line, row in found.items()}
        print(json.dumps({"python_ms": bare.best, "commands": rows_of}, indent=2))
    else:
        rows = [("python -c pass", f"{bare.best:.0f}", "1.0", "", "")]
        rows += [
            (line, f"{row.ms:.0f}", f"{row.ms / row.python_ms:.1f}", f"{row.limit:g}", row.verdict)
            for line, row in found.items()
        ]
        columns = (
            Column("command"),
            Column("ms", right=True),
            Column("x bare Python", right=True),
            Column("limit x", right=True),
            Column("verdict"),
        )
        print(fitted_table(columns, rows).text)
    missed = any(row.is_missed for row in found.values())
    return 1 if missed else REFUSED if bare.refused else 0


if __name__ == "__main__":
    sys.exit(main())
