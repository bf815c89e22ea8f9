"""What the processes of a node on a small computer load, and how much memory that takes."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.table import scan

SERVICES: Final = (
    *("broker", "tree", "register", "timesync", "health", "guard", "mission", "logger", "hal", "sim"),
    *("control", "navigator"),
)
HEAVY: Final = {
    *("click", "cryptography", "jsonschema", "matplotlib", "mcap", "numpy", "psutil", "pymongo", "rich"),
    *("_bz2", "_hashlib", "_lzma", "_ssl", "argparse", "email", "http", "pydoc"),
    *("importlib.metadata", "importlib.resources", "shutil", "ssl", "swarmctl", "swarmlab"),
    *("swarmware.testing", "unittest", "urllib.request", "zipfile", "zmq.asyncio"),
}
"""None of these is of use to a running node."""
UNUSED: Final = {
    *("pty", "statistics", "swarmd.broker.records.metrics_server", "swarmd.logger.log_forwarder"),
    *("swarmd.navigator.core.air_controller", "swarmd.sim.core.multirotor", "swarmd.sim.core.surface"),
    *("swarmd.sim.serial_ports", "swarmware.devices.nmea", "swarmware.model.airframe"),
}
"""Modules of the database, the metrics page, kinds of vehicles and serial devices, which this node lacks."""
LIBRARIES: Final = re.compile(r"lib(crypto|ssl)[.-]|/cryptography/|/numpy")
RATIO: Final = 5.4
"""Resident memory of a whole node, as a multiple of an interpreter that does nothing. Measured from sources
without bytecode: 5.21 (45.6 MB), and 5.04 with late imports that saved less than 0.5 MB each."""
PARENT_RATIO: Final = 1.25
"""The same of the parent: 1.18 when this was written, from sources without bytecode; 1.3 before."""
WRITES_NO_BYTECODE: Final = {"PYTHONDONTWRITEBYTECODE": "1"}
"""The first process that compiles the sources and writes their bytecode keeps 2.5 MB of what that took: the
figure would depend on which test came first."""
_MARK: Final = "import time:"


def resident_kb(pid: int | str) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")))


def bare_kb() -> int:
    code = "print(*(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmRSS')))"
    return int(subprocess.check_output([sys.executable, "-c", code]))


def mapped(pid: int) -> set[str]:
    """Files that a process has mapped."""
    return {line.split()[-1] for line in Path(f"/proc/{pid}/maps").read_text().splitlines()}


def imported(errors: str) -> set[str]:
    """Modules of the report that the interpreter writes with `-X importtime`."""
    return {line.rpartition("|")[2].strip() for line in errors.splitlines() if line.startswith(_MARK)}


async def test_node_loads_no_optional_library_and_stays_small(tmp_path: Path) -> None:
    config = make_node(tmp_path, kind="ugv", services={name: {} for name in SERVICES})
    async with spawn(config, *SERVICES, env={"PYTHONPROFILEIMPORTTIME": "1"} | WRITES_NO_BYTECODE) as process:
        loaded = imported(process.stderr())
        assert {
            "asyncio",
            "zmq",
            "swarmd.broker.exchange.frame_gateway",
            "swarmd.navigator.core.dwa",
        } <= loaded
        assert loaded & (HEAVY | UNUSED) == set()
        assert not {name for name in mapped(process.pid) if LIBRARIES.search(name)}
        assert {entry.pid for entry in scan(tmp_path / "uav1/run")} == {process.pid}
        assert resident_kb(process.pid) / bare_kb() < RATIO


async def test_parent_of_node_is_hardly_larger_than_interpreter(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"register": {}})
    async with spawn(config, env=WRITES_NO_BYTECODE) as parent:
        assert {entry.pid for entry in scan(tmp_path / "uav1/run")}.isdisjoint({parent.pid})
        assert resident_kb(parent.pid) / bare_kb() < PARENT_RATIO


async def test_node_with_foreign_plugin_can_use_tls(tmp_path: Path) -> None:
    (tmp_path / "theirs-1.0.dist-info").mkdir()
    (tmp_path / "theirs-1.0.dist-info/entry_points.txt").write_text("[swarmware.drivers]\nx = theirs:make\n")
    config = make_node(tmp_path, services={"register": {}})
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    env = {"PYTHONPROFILEIMPORTTIME": "1", "PYTHONPATH": path}
    async with spawn(config, "register", env=env) as process:
        assert "ssl" in imported(process.stderr())
