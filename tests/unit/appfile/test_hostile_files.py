"""Whatever lies in the folder of the application files, a node reads it at once, and goes on."""

import fcntl
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from tests.unit.shm.folders import folder, full_folder, link, listener

from swarmware.errors import OutOfRange
from swarmware.transport.appfile.entry import FILE_LIMIT, AppEntry, encode
from swarmware.transport.appfile.file import AppFile
from swarmware.transport.appfile.table import WRITING_TIME_NS, AppTable, populated
from swarmware.transport.appfile.trace import died, last_of, set_aside


def join(run_dir: Path, name: str, instance: int | None = None) -> AppFile:
    return AppFile(run_dir, name, endpoint="ipc:///tmp/x", started_ns=1, instance=instance)


@pytest.fixture
def tree(tmp_path: Path) -> Iterator[AppFile]:
    app = join(tmp_path, "tree")
    yield app
    app.close()


def sparse(path: Path) -> None:
    """A file of 4 GB whose lock a process holds."""
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o640)
    os.ftruncate(fd, 4 << 30)
    fcntl.flock(fd, fcntl.LOCK_EX)  # open until the end of the test process


HOSTILE = [os.mkfifo, folder, full_folder, link, listener, sparse]


@pytest.mark.parametrize("make", HOSTILE)
def test_invalid_file_is_left_out_and_named(
    tmp_path: Path, tree: AppFile, make: Callable[[Path], None]
) -> None:
    strange = tmp_path / "apps/a#1.toml"
    make(strange)
    table = AppTable(tmp_path)
    for _ in range(2):
        table.refresh(probe=True)
        assert [entry.id for entry in table] == ["tree#1"]
        assert len(table.rejections) == 1
        assert table.rejections[0].startswith(f"{strange}: ")
    assert populated(tmp_path)
    tree.close()
    assert not populated(tmp_path)


@pytest.mark.parametrize("make", HOSTILE)
def test_an_application_takes_its_place(tmp_path: Path, make: Callable[[Path], None]) -> None:
    (tmp_path / "apps").mkdir()
    make(tmp_path / "apps/tree#1.dead")
    if make is not sparse:  # its lock is held by a process that lives
        make(tmp_path / "apps/tree#1.toml")
    app = join(tmp_path, "tree", 1)
    table = AppTable(tmp_path)
    table.refresh()
    assert list(table) == [app.entry]
    app.close()


@pytest.mark.parametrize("make", HOSTILE)
def test_trace_of_dead_application_is_read_and_replaced(tmp_path: Path, make: Callable[[Path], None]) -> None:
    app = join(tmp_path, "planner")
    aside = app.path.with_suffix(".dead")
    make(aside)
    assert not died(tmp_path, app.entry)
    assert last_of(tmp_path, "planner") is None
    os.close(app._fd)
    set_aside(app.path)
    assert died(tmp_path, app.entry)


def write_locked(path: Path, data: bytes) -> int:
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o640)
    fcntl.flock(fd, fcntl.LOCK_EX)
    os.write(fd, data)
    return fd


@pytest.mark.parametrize("claimed", [("tree", 1), ("tool", 2), ("tree", 0)])
def test_file_that_states_another_application_is_left_out(
    tmp_path: Path, tree: AppFile, claimed: tuple[str, int]
) -> None:
    name, instance = claimed
    entry = msgspec.structs.replace(tree.entry, name=name, instance=instance, endpoint="ipc:///evil")
    fd = write_locked(tmp_path / "apps/tool#1.toml", encode(entry))
    table = AppTable(tmp_path)
    table.refresh()
    assert list(table) == [tree.entry]
    assert f"states application {entry.id}" in table.rejections[0]
    os.close(fd)


def rejections(table: AppTable) -> list[str]:
    return list(table.rejections)


def test_damaged_file_is_named_and_completed_file_read(tmp_path: Path, tree: AppFile) -> None:
    entry = msgspec.structs.replace(tree.entry, name="tool")
    data = encode(entry)
    fd = write_locked(tmp_path / "apps/tool#1.toml", data[:-3])
    now_ns = 0
    table = AppTable(tmp_path, now_ns=lambda: now_ns)
    for later_ns in (0, 1_000_000, WRITING_TIME_NS - 1):
        now_ns = later_ns
        table.refresh(probe=True)
        assert rejections(table) == [], "its writer may have lost the processor"
    now_ns = WRITING_TIME_NS
    assert len(rejections(table)) == 1
    assert rejections(table)[0].startswith(f"{tmp_path}/apps/tool#1.toml: incomplete")
    os.pwrite(fd, data, 0)
    table.refresh(probe=True)
    assert {found.name for found in table} == {"tool", "tree"}
    assert rejections(table) == []
    os.close(fd)


def test_application_with_too_many_resources_is_refused(tmp_path: Path, tree: AppFile) -> None:
    before = tree.path.read_bytes()
    large: AppEntry = msgspec.structs.replace(tree.entry, types={"Big": "x" * FILE_LIMIT})
    with pytest.raises(OutOfRange, match=f"expected at most {FILE_LIMIT}"):
        tree.write(large)
    assert tree.path.read_bytes() == before


def test_application_that_leaves_keeps_file_of_its_successor(tmp_path: Path) -> None:
    first = join(tmp_path, "tree")
    first.path.unlink()
    second = join(tmp_path, "tree")
    assert second.path == first.path
    first.close()
    assert second.path.exists()
    second.close()
