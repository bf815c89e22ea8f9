"""Nodes of real processes whose folders hold what does not belong there, or are cleaned while they run."""

import asyncio
import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.integration.node.commands import VEHICLE, swarmctl
from tests.patience import PATIENCE_S, until, until_answer
from tests.ports import free_port

from swarmware.errors import Denied
from swarmware.module.module import Module
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.table import scan
from swarmware.transport.shm.shared_file import kind_at
from swarmware.types.health import FaultList, FaultQuery
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo

FEW = ("tree", "register", "health")


@pytest.fixture
def root() -> Iterator[Path]:
    """A folder with a short path."""
    folder = Path(tempfile.mkdtemp(prefix="sw", dir="/tmp"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def sparse(path: Path) -> None:
    """4 GB without content, locked as by a living application."""
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o640)
    os.ftruncate(fd, 4 << 30)
    fcntl.flock(fd, fcntl.LOCK_EX)  # until the test process ends


def clutter(run_dir: Path) -> list[Path]:
    """One of each kind of file that a member of the group can put into the folders of a node."""
    made = []
    for folder, suffix in (("apps", "#1.toml"), ("apps", "#1.dead"), ("p", ".sock")):
        (run_dir / folder).mkdir(parents=True, exist_ok=True)
        for name, make in (
            ("a", os.mkfifo),
            ("b", os.mkdir),
            ("c", lambda path: (path / "inner").mkdir(parents=True)),
            ("d", lambda path: path.symlink_to("/etc/passwd")),
            ("e", sparse),
        ):
            path = run_dir / folder / f"{name}{suffix}"
            make(path)
            made.append(path)
    return made


async def gone(paths: list[Path]) -> None:
    await until(lambda: all(kind_at(path) == "no file" for path in paths))


async def has_fault(m: Module, check: str) -> None:
    """Returns when a fault is confirmed, by the next reports."""
    await until_answer(
        lambda: m.request("sys/health/faults", FaultQuery(), FaultList, timeout_s=PATIENCE_S),
        lambda found: check in {fault.check for fault in found.faults},
    )


async def info(m: Module) -> NodeInfo:
    return await m.request("sys/node/info", Empty(), NodeInfo, timeout_s=PATIENCE_S)


def test_node_answers_whatever_its_folders_contain(root: Path) -> None:
    async def run() -> None:
        config = make_node(root, services={name: {} for name in FEW})
        run_dir = root / "uav1/run"
        before = clutter(run_dir)
        async with spawn(config) as node, Module("probe", config_dir=config) as m:
            assert {entry.name for entry in scan(run_dir)} == {*FEW, "probe"}
            await info(m)
            await gone(before)
            during = [path for path in clutter(run_dir) if path.suffix == ".toml"]
            await info(m)
            await gone(during)
            await info(m)
            assert node.returncode is None
            await has_fault(m, "register/applications")
            log = node.stderr()
            for path in during:
                assert log.count(f"WARNING swarm.master: applications: {path}: ") == 1

    asyncio.run(run())


STRANGER = 60_103


def open_folder(path: Path) -> None:
    path.mkdir()
    path.chmod(0o777)


def stranger(make: Callable[[Path], Any]) -> Callable[[Path], None]:
    def made(path: Path) -> None:
        make(path)
        os.chown(path, STRANGER, STRANGER, follow_symlinks=False)

    return made


@pytest.mark.root
@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to make the folder of another user")
@pytest.mark.parametrize("processes", ["one", "per-daemon"])
@pytest.mark.parametrize(
    ("make", "kind"),
    [
        (stranger(open_folder), "a folder of user 60103"),
        (stranger(lambda path: path.mkdir(mode=0o700)), "a folder of user 60103"),
        (stranger(lambda path: path.symlink_to("/tmp")), "a symbolic link"),
        (stranger(lambda path: path.touch()), "a regular file"),
        (open_folder, "a folder that all users may write"),
    ],
    ids=["open", "closed", "link", "file", "own-open"],
)
def test_node_with_foreign_shared_memory_ends_with_message(
    root: Path, make: Callable[[Path], None], kind: str, processes: str
) -> None:
    config = make_node(root, services={"guard": {}, "tree": {}}, processes=processes)
    shm = root / "uav1/shm"
    make(shm)
    before = shm.lstat()
    done = subprocess.run(
        [sys.executable, "-m", "swarmd", "node", "--config", str(config)],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert done.returncode == Denied.exit_code
    assert done.stderr.startswith(f"swarmd: {shm}: {kind}; expected none, or a folder of user root")
    assert done.stderr.count("\n") == 1
    assert shm.lstat() == before
    assert not list((root / "uav1/run").rglob("*.toml"))


def apps(run_dir: Path) -> None:
    """As a cleaner of temporary files, which removes what has not changed for days."""
    for path in (run_dir / "apps").iterdir():
        path.unlink()


def files(run_dir: Path) -> None:
    for path in list(run_dir.rglob("*")):
        if not path.is_dir():
            path.unlink()


def folder(run_dir: Path) -> None:
    shutil.rmtree(run_dir)


@pytest.mark.parametrize("processes", ["one", "per-daemon"])
def test_vehicle_with_cleaned_run_folder_obeys_and_reports(root: Path, processes: str) -> None:
    async def run() -> None:
        services: dict[str, dict[str, Any]] = {name: {} for name in VEHICLE}
        services["broker"] = {"bind_address": "127.0.0.1", "multicast_group": "", "udp_port": free_port()}
        config = make_node(root, services=services, processes=processes)
        run_dir = root / "uav1/run"
        async with spawn(config) as node:
            await swarmctl(config, "takeoff", "uav1", "--altitude", "5", "--timeout", str(PATIENCE_S))
            pids = {entry.name: entry.pid for entry in scan(run_dir)}
            for clean in (apps, files, folder):
                clean(run_dir)
                began_s = time.monotonic()
                await until(lambda: {e.name: e.pid for e in scan(run_dir)} == pids)
                print(f"{processes}, {clean.__name__}: back after {time.monotonic() - began_s:.2f} s")
                await swarmctl(config, "hold", "uav1")
            await swarmctl(config, "land", "uav1", "--timeout", str(PATIENCE_S))
            output = await swarmctl(config, "health", "faults", code=None)
            assert "/files" in output
            assert "made again" in output
            assert {entry.name: entry.pid for entry in scan(run_dir)} == pids, "no daemon was started again"
            assert "made again" in node.stderr()
            assert node.returncode is None
            async with Module("probe", config_dir=config) as m:
                assert m.node.clock.boot_id == (await info(m)).boot_id

    asyncio.run(run())
