"""Files of a running node that are removed under it are made again, and the node is reached as before."""

import asyncio
import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.patience import until

from swarmware.errors import Conflict
from swarmware.model import paths
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.node import node as node_module
from swarmware.node.incarnation import NodeIncarnation
from swarmware.node.node import Node
from swarmware.node.run_files import Damage, RunFiles
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.appfile.file import AppFile
from swarmware.transport.appfile.table import scan
from swarmware.types.scalar import Int


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_module, "TEND_NS", 10_000_000)
    monkeypatch.setattr(node_module, "TEND_PHASE_NS", 0)


def applications(node: Node) -> list[Path]:
    return list(paths.applications(node.run_dir).iterdir())


def sockets(node: Node) -> list[Path]:
    return list(paths.sockets(node.run_dir).iterdir())


def bells(node: Node) -> list[Path]:
    return list(paths.doorbells(node.run_dir).iterdir())


def locks(node: Node) -> list[Path]:
    return [node.run_dir / "boot", node.run_dir / "master.lock"]


def everything(node: Node) -> list[Path]:
    return [*applications(node), *sockets(node), *bells(node), *locks(node)]


def folders(node: Node) -> list[Path]:
    return [found(node.run_dir) for found in (paths.applications, paths.sockets, paths.doorbells)]


def run_folder(node: Node) -> list[Path]:
    return [node.run_dir]


def remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()


def replace(path: Path) -> None:
    """Another file of the same content takes the place, as of a backup that was restored."""
    kept = path.with_name("kept")
    if path.is_fifo():
        os.mkfifo(kept)
    elif path.is_socket():
        kept.touch()
    else:
        shutil.copy(path, kept)
    kept.replace(path)


def double(request: Int, meta: Meta) -> Int:
    return Int(2 * request.value)


@pytest.mark.parametrize(
    ("which", "damage"),
    [
        *((one, remove) for one in (applications, sockets, bells, locks, everything, folders, run_folder)),
        *((one, replace) for one in (applications, sockets, bells, locks, everything)),
    ],
)
async def test_removed_and_replaced_files_are_recreated(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    which: Callable[[Node], list[Path]],
    damage: Callable[[Path], None],
) -> None:
    reported: list[Damage] = []
    async with tmp_node(tmp_path) as node, Module("server", node=node) as m:
        node.on_damage = reported.append
        m.serve("survey/double", Int, double)
        await until(lambda: any(entry.serves for entry in scan(node.run_dir)))
        entry, epoch = m.entry, node.master.holder.epoch
        chosen = which(node)
        lost = {str(path) for path in everything(node) if {path, *path.parents} & {*chosen}}
        for path in chosen:
            damage(path)
        await until(lambda: {path for one in reported for path in one.repaired} == lost)
        await until(lambda: scan(node.run_dir) == [entry])
        assert node.master.holder.epoch == epoch
        assert node.master.holder.pid == os.getpid()
        assert await m.request("survey/double", Int(4), Int) == Int(8)
        assert reported
        assert not any(damage.errors for damage in reported)
        assert "removed or replaced while the node runs; made again" in caplog.text
    assert everything_left(tmp_path) == []


def everything_left(root: Path) -> list[Path]:
    return [path for path in (root / "uav1/run").rglob("*") if not path.is_dir() and path.name not in LOCKS]


LOCKS = {"boot", "master.lock"}


async def test_unrecreatable_file_is_reported_once_and_retried(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    reported: list[Damage] = []
    async with tmp_node(tmp_path) as node, Module("server", node=node) as m:
        node.on_damage = reported.append
        path = paths.applications(node.run_dir) / paths.application_file("server", 1)
        path.unlink()
        other = AppFile(node.run_dir, "server", endpoint="ipc:///other", started_ns=1, instance=1)
        await until(lambda: bool(reported))
        await asyncio.sleep(0.05)
        assert len(reported) == 1
        assert "server#1.toml: removed, and taken by another process" in reported[0].errors[0]
        assert caplog.text.count("taken by another process") == 1
        other.close()
        await until(lambda: scan(node.run_dir) == [m.entry])
        assert reported[-1] == Damage((str(path),), ())


async def test_process_that_comes_meanwhile_joins_running_incarnation(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("server", node=node) as m:
        (node.run_dir / "boot").unlink()
        other = await asyncio.to_thread(NodeIncarnation, node.run_dir, node.shm_dir)
        assert other.boot_id == node.clock.boot_id
        assert scan(node.run_dir) == [m.entry], "its files are not swept away"
        other.leave()


async def test_late_process_joins_after_folder_removal(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("server", node=node) as m:
        m.writer("survey/count", Int).write(Int(1))
        shutil.rmtree(node.run_dir)
        other = await asyncio.to_thread(NodeIncarnation, node.run_dir, node.shm_dir)
        assert other.boot_id == node.clock.boot_id
        await until(lambda: scan(node.run_dir) == [m.entry])
        other.leave()


def test_foreign_lock_ends_start_with_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmware.node.incarnation.LOCK_WAIT_S", 0.01)
    run_dir = tmp_path / "run"
    first = NodeIncarnation(run_dir, tmp_path / "shm")
    with (run_dir / "boot").open("rb") as kept:
        fcntl.flock(first._fd, fcntl.LOCK_UN)
        fcntl.flock(kept, fcntl.LOCK_EX)
        with pytest.raises(Conflict, match=r"run/boot: locked by another process for more than 0.01 s"):
            NodeIncarnation(run_dir, tmp_path / "shm")
    first.leave()


def test_group_returns_with_its_run_folder(tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    run_dir.mkdir(mode=0o750)
    node = NodeIncarnation(run_dir, tmp_path / "shm")
    shutil.rmtree(run_dir)
    assert node.tend() == run_dir / "boot"
    assert run_dir.stat().st_mode & 0o777 == 0o750
    assert node.tend() is None
    node.leave()


def test_each_file_is_tended_although_another_cannot_be() -> None:
    def broken() -> Path | None:
        raise PermissionError("no")

    files = RunFiles()
    files.keep(broken)
    files.keep(lambda: Path("/run/x"))
    repaired, errors = files.tend()
    assert repaired == ["/run/x"]
    assert len(errors) == 1
    files.release(broken)
    assert files.tend() == (["/run/x"], [])
