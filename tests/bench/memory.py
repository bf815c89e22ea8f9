"""Memory that each trick of share/doc/explanation/memory.md saves in a node, by undoing one at a time.

    python tests/bench/memory.py [TRICK…] [--rounds N]

A node with the twelve services of a ground vehicle runs from a copy of the sources. Its memory is the
proportional set size (PSS) of its processes after 6 s, and beside it the private pages alone: other Python
processes of this computer share pages with the node and change its PSS, but not its private pages.
"""

import argparse
import compileall
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final, NamedTuple

from swarmware.testing.tmpnode import make_node

ROOT: Final = Path(__file__).parents[2]
FOLDERS: Final = ("lib", "daemons", "cli", "share/swarm")
SERVICES: Final = "broker tree register timesync health guard mission logger hal sim control navigator"
SETTLED_S: Final = 6.0
"""After `ready`: the objects of the start are frozen, and the rings are mapped."""
READY_S: Final = 60.0
MB: Final = 1e6

PARENT: Final = "daemons/swarmd/parent.py"
NODE: Final = "lib/swarmware/service/runner.py"
MAIN: Final = "daemons/swarmd/main.py"
KINDS: Final = (
    "swarmware.model.airframe_file, swarmd.hal.core.flight.flight_core, swarmd.hal.drivers.sim_flight,"
    "swarmd.sim.core.fixed_wing_airframe, swarmd.sim.core.helicopter_airframe,"
    "swarmd.sim.core.multirotor_airframe, swarmd.sim.core.multirotor, swarmd.sim.core.ground,"
    "swarmd.sim.core.surface, swarmd.navigator.core.circling_controller,"
    "swarmd.navigator.core.air_controller, swarmd.navigator.core.ground_controller"
)


class Change(NamedTuple):
    """Text of one source file that undoes a trick; without `before` it is appended."""

    file: str
    after: str
    before: str = ""


def importing(modules: str, file: str = NODE) -> Change:
    return Change(file, f"\nimport {modules}\n")


TRICKS: Final = {
    "parent-annotations": importing("typing", PARENT),
    "parent-plain": importing("signal, socket", PARENT),
    "parent-pathlib": importing("pathlib, contextlib", PARENT),
    "parent-program": Change(PARENT, '"-m", "swarmd.parent", *words]', '"-c", ENTRY, *words]'),
    "parent-exec": Change(
        PARENT,
        "sys.exit(main(words))",
        'os.execv(sys.executable, [sys.executable, "-P", "-c", ENTRY, *words])',
    ),
    "tls": Change(MAIN, "if False:", "if none_is_foreign():"),
    "blake2b": importing("hashlib"),
    "entry-points": importing("importlib.metadata"),
    "mcap": importing("mcap.writer"),
    "psutil": importing("psutil"),
    "argparse": importing("argparse, shutil"),
    "numpy": importing("numpy"),
    "mongodb": importing("swarmware.recorder.mongo, swarmd.logger.log_forwarder"),
    "metrics": importing("swarmd.broker.records.metrics_server, swarmd.broker.core.reports.metrics_page"),
    "kinds": importing(KINDS),
    "serial": importing("swarmd.sim.serial_ports, swarmd.sim.core.serial_devices, swarmd.sim.pulse_inputs"),
}
"""The change that undoes each trick."""
ENDED: Final = Change(PARENT, '\nif __name__ == "__main__":\n    sys.exit(main(sys.argv[1:]))\n')
"""The parent as a program, for `-m`."""


class Memory(NamedTuple):
    """Memory of the processes of a node."""

    proportional: float
    private: float


def undone(sources: Path, changes: list[Change]) -> None:
    """Write the changed files. Raises: ValueError when a file has another text by now."""
    for change in changes:
        path = sources / change.file
        text = path.read_text("utf-8")
        if change.before not in text:
            raise ValueError(f"{change.file}: has no {change.before!r}")
        path.write_text(text.replace(change.before, change.after) if change.before else text + change.after)
        # the first process that compiles a file keeps 2.5 MB of what that takes
        compileall.compile_file(path, quiet=1, force=True)


def copied(sources: Path) -> None:
    for folder in FOLDERS:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / folder, sources / folder, ignore=ignored, dirs_exist_ok=True)
    compileall.compile_dir(sources, quiet=1)


def processes(pid: int) -> list[int]:
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [pid, *(inner for child in children for inner in processes(int(child)))]


def memory(pids: list[int]) -> Memory:
    """Source: proc_pid_smaps(5), smaps_rollup."""
    lines = [
        line.split() for pid in pids for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    ]
    bytes_of = {
        start: sum(int(line[1]) * 1024 for line in lines if line[0].startswith(start))
        for start in ("Pss:", "Private_")
    }
    return Memory(bytes_of["Pss:"], bytes_of["Private_"])


def measured(sources: Path, folder: Path) -> Memory:
    """Memory of a node that runs from these sources. Raises: RuntimeError when it does not start."""
    config = make_node(folder, kind="ugv", services={name: {} for name in SERVICES.split()})
    path = os.pathsep.join(str(sources / name) for name in ("lib", "daemons", "cli"))
    environment = {key: text for key, text in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, "-m", "swarmd", "node", "--config", str(config)]
    output = folder / "output"
    with output.open("w") as file:
        node = subprocess.Popen(command, env=environment | {"PYTHONPATH": path}, stderr=file, cwd="/")
    try:
        deadline_s = time.monotonic() + READY_S
        while "ready: " not in output.read_text():
            if node.poll() is not None or time.monotonic() > deadline_s:
                raise RuntimeError(output.read_text())
            time.sleep(0.1)
        time.sleep(SETTLED_S)
        return memory(processes(node.pid))
    finally:
        node.send_signal(signal.SIGTERM)
        node.wait(30)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tricks", nargs="*", metavar="TRICK", help=", ".join(TRICKS))
    parser.add_argument("--rounds", type=int, default=1)
    given = parser.parse_args()
    saved: dict[str, list[Memory]] = {}
    print("trick                PSS MB  private MB")
    for _ in range(given.rounds):
        with tempfile.TemporaryDirectory() as name:
            sources = Path(name) / "sources"
            copied(sources)
            base = measured(sources, Path(name) / "base")
            saved.setdefault("whole node", []).append(base)
            for trick in given.tricks or TRICKS:
                undone(sources, [TRICKS[trick], *([ENDED] if trick == "parent-program" else [])])
                found = measured(sources, Path(name) / trick)
                difference = (now - before for now, before in zip(found, base, strict=True))
                saved.setdefault(trick, []).append(Memory(*difference))
                copied(sources)
    for trick, found_each in saved.items():
        proportional, private = (statistics.median(column) / MB for column in zip(*found_each, strict=True))
        print(f"{trick:20} {proportional:6.2f} {private:11.2f}")


if __name__ == "__main__":
    main()
